// The part of tools/check_page that drives the browser: PROGRAM SCENE FOLDER CAMERAS, with the page as FOLDER/page.html.
"use strict";
const fs = require("fs");
const path = require("path");
const { looks, openPage, psnr, renderedBy, startBrowser } = require("./browser/browser.cjs");

const LEAST_PSNR_DB = 35;
const MOST_BYTES_BESIDE_SCENE = 300_000;
const VIEWS = Number(process.env.VIEWS ?? 3);
/** Of the window that is clicked in: software rendering takes time by the pixel. */
const CLICKED = { width: 820, height: 420 };
/** Width of what the panel covers there. */
const PANEL_WIDTH = 320;

const [program, scene, folder, camerasFile] = process.argv.slice(2);
const file = path.join(folder, "page.html");
const address = `file://${file}`;
const failures = [];
const check = (holds, what) => {
  if (!holds) failures.push(what);
};

/** Our own pictures: cameras spread over the file, or three on a circle. */
function rendered() {
  let cameras;
  if (camerasFile) {
    const all = [].concat(JSON.parse(fs.readFileSync(camerasFile, "utf8")));
    const step = Math.max(1, Math.ceil(all.length / VIEWS));
    cameras = all.filter((_, i) => i % step === 0).map((camera, i) => ({ ...camera, name: `view${i}` }));
  } else {
    cameras = circle(JSON.parse(/id="start-data">([^<]*)</.exec(fs.readFileSync(file, "utf8"))[1]));
  }
  const pngs = renderedBy(program, scene, cameras, folder);
  return cameras.map((camera, i) => ({ camera, png: pngs[i] }));
}

/** Cameras around the scene, from what the page knows of it. */
function circle({ center, distance, up }) {
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((v) => v / Math.hypot(...a));
  const side = unit(cross(up, Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const front = cross(side, up);
  return Array.from({ length: VIEWS }, (_, i) => {
    const angle = (2 * Math.PI * i) / VIEWS;
    const level = [0, 1, 2].map((k) => front[k] * Math.cos(angle) + side[k] * Math.sin(angle));
    const back = unit([0, 1, 2].map((k) => level[k] + 0.36 * up[k]));
    const eye = [0, 1, 2].map((k) => center[k] + distance * back[k]);
    const forward = back.map((v) => -v);
    const right = unit(cross(forward, up));
    const row = (axis) => [...axis, -axis.reduce((sum, v, k) => sum + v * eye[k], 0)];
    const view_from_world = [row(right), row(cross(forward, right)), row(forward), [0, 0, 0, 1]];
    return { name: `view${i}`, width: 480, height: 320, fx: 343, fy: 343, cx: 240, cy: 160, view_from_world };
  });
}

/** The page with its first picture. */
async function opened(browser, options, hash = "") {
  const { page, close } = await openPage(browser, address + hash, options, failures);
  const ready = await page.evaluate(() => window.instgs.ready);
  return { page, ready, close };
}

/** The canvas alone, at the camera's size. */
async function pictureOf(page, camera) {
  await page.evaluate((of) => window.instgs.setCamera(of), camera);
  return page.locator("#picture").screenshot();
}

async function comparePictures(browser, comparer, views, drawsWith) {
  const width = Math.max(...views.map(({ camera }) => camera.width));
  const height = Math.max(...views.map(({ camera }) => camera.height));
  const options = { viewport: { width, height } };
  const hash = `#camera=${encodeURIComponent(JSON.stringify(views[0].camera))}`;
  const { page, ready, close } = await opened(browser, options, hash);
  const used = await page.evaluate(() => window.instgs.drawsWith());
  check(used === drawsWith, `the page draws with ${used}, not with ${drawsWith}`);
  const first = await page.locator("#picture").screenshot();
  const same = first.equals(await pictureOf(page, views[0].camera));
  check(same, "the camera of the address and of the program give different pictures");
  const values = [];
  for (const { camera, png } of views) values.push(await psnr(comparer, png, await pictureOf(page, camera)));
  // A picture of another view must not pass.
  if (views.length > 1) {
    const wrong = await psnr(comparer, views[1].png, first);
    check(wrong < LEAST_PSNR_DB, `the pictures of two views are alike (${wrong.toFixed(1)} dB): they prove nothing`);
  }
  values.forEach((value, i) => {
    check(value >= LEAST_PSNR_DB, `view ${i}, ${used}: ${value.toFixed(2)} dB is below ${LEAST_PSNR_DB}`);
  });
  await close();
  return { ready, values };
}

/** Clicks an object, hides it, colours it; returns how many objects clicks found. */
async function useIt(browser) {
  const { page, close } = await opened(browser, { viewport: CLICKED });
  // Without the panel, whose list may have been scrolled.
  const picture = () => page.screenshot({ clip: { x: 0, y: 0, width: CLICKED.width - PANEL_WIDTH, height: CLICKED.height } });
  const { names } = await page.evaluate(() => window.instgs.objects());
  if (names.length === 0) {
    await close();
    return 0;
  }
  // A grid of places left of the panel; the first that shows an instance is used.
  const places = [];
  for (let y = 20; y < CLICKED.height; y += 30) {
    for (let x = 20; x < CLICKED.width - PANEL_WIDTH; x += 30) places.push({ x, y });
  }
  const pickAll = async (all) => {
    const found = [];
    for (const { x, y } of all) found.push({ x, y, object: await window.instgs.pick(x, y) });
    return found.filter(({ object }) => object !== null && object >= 0);
  };
  const hits = await page.evaluate(pickAll, places);
  const found = new Set(hits.map(({ object }) => object));
  const at = hits[0] ?? null;
  check(at !== null, "no place of the first view shows an instance");
  if (at === null) {
    await close();
    return 0;
  }
  const plain = await picture();
  await page.mouse.click(at.x, at.y);
  await page.locator("#selection").waitFor();
  const state = () => page.evaluate(() => window.instgs.objects());
  check((await state()).selected.join() === String(at.object), "a click does not select what is there");
  check(!(await picture()).equals(plain), "what is selected looks as before");
  await page.locator("#hide-selected").click();
  check((await state()).hidden.join() === String(at.object), "the button does not hide what is selected");
  const behind = await page.evaluate(([x, y]) => window.instgs.pick(x, y), [at.x, at.y]);
  check(behind !== at.object, "what is hidden is still found");
  await page.locator("#show-all").click();
  await page.locator("#colour").fill("#ff00ff");
  await page.keyboard.press("Escape");
  await page.locator("#deselect").click();
  await page.evaluate(() => window.instgs.select([]));
  check(!(await picture()).equals(plain), "a colour changes nothing");
  await page.evaluate((object) => window.instgs.setLook([object], { tint: null }), at.object);
  await page.mouse.move(5, 5);
  check((await picture()).equals(plain), "the picture does not come back");
  await moveAbout(page);
  await close();
  return found.size;
}

/** Drag, wheel and keys move the camera, and the first view comes back. */
async function moveAbout(page) {
  const camera = () => page.evaluate(async () => JSON.stringify(await window.instgs.camera()));
  const first = await camera();
  const acts = {
    dragging: async () => {
      await page.mouse.move(200, 200);
      await page.mouse.down();
      await page.mouse.move(260, 230, { steps: 4 });
      await page.mouse.up();
    },
    "the wheel": () => page.mouse.wheel(0, 200),
    "the key W": () => page.keyboard.press("w", { delay: 200 }),
  };
  for (const [name, act] of Object.entries(acts)) {
    const before = await camera();
    await act();
    check((await camera()) !== before, `${name} does not move the camera`);
  }
  await page.locator("#reset").click();
  check((await camera()) === first, "the first view does not come back");
}

async function takeShots(browser, to) {
  fs.mkdirSync(to, { recursive: true });
  for (const { name, isPhone, options } of looks()) {
    const { page, close } = await opened(browser, options);
    await page.screenshot({ path: path.join(to, `${name}.png`) });
    if (isPhone) await page.locator("#fold-panel").tap();
    await page.evaluate(() => window.instgs.select([0]));
    await page.screenshot({ path: path.join(to, `${name}_selected.png`) });
    await close();
  }
}

(async () => {
  const text = fs.readFileSync(file, "utf8");
  const bytes = Buffer.byteLength(text);
  const sceneBytes = /id="scene-data">([^<]*)</.exec(text)[1].length;
  const beside = bytes - sceneBytes;
  check(beside < MOST_BYTES_BESIDE_SCENE, `the page has ${beside} bytes beside its scene`);
  let browser = await startBrowser();
  try {
    const comparer = await browser.newPage();
    const views = rendered();
    const told = ({ ready, values }) =>
      `first picture after ${Math.round(ready)} ms, PSNR ${values.map((value) => value.toFixed(2)).join(", ")} dB`;
    const webgl2 = told(await comparePictures(browser, comparer, views, "webgl2"));
    const found = await useIt(browser);
    if (process.env.SHOTS) await takeShots(browser, process.env.SHOTS);
    await browser.close();
    browser = await startBrowser(true);
    const webgpu = told(await comparePictures(browser, await browser.newPage(), views, "webgpu"));
    check((await useIt(browser)) === found, "clicks find other instances with WebGPU than with WebGL2");
    console.log(`check_page: ${bytes} bytes (${beside} beside the scene); WebGL2: ${webgl2}; WebGPU: ${webgpu}; ` +
      `${found} instances found by clicking`);
  } finally {
    await browser.close();
  }
  failures.forEach((failure) => console.error(`check_page: ${failure}`));
  process.exit(failures.length > 0 ? 1 : 0);
})();
