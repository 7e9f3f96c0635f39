// The part of tools/check_report that drives the browser: PROGRAM RUN FOLDER.
"use strict";
const fs = require("fs");
const path = require("path");
const { looks, openPage, psnr, renderedBy, startBrowser } = require("./browser/browser.cjs");

const LEAST_PSNR_DB = 35;
/** Above this, two screenshots of one picture; browsers do not always round alike. */
const SAME_PSNR_DB = 50;
const DESKTOP = { viewport: { width: 1280, height: 800 } };
const PHONE = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true };

const [program, run, folder] = process.argv.slice(2);
const file = path.join(run, "report.html");
const failures = [];
const check = (holds, what) => {
  if (!holds) failures.push(what);
};
const opened = (browser, options) => openPage(browser, `file://${file}`, options, failures);

/** The frame with the scene, after its first picture, and how long that took. */
async function sceneOf(page) {
  const holder = page.locator("iframe.scene");
  await holder.scrollIntoViewIfNeeded();
  const frame = await (await holder.elementHandle()).contentFrame();
  await frame.waitForFunction(() => window.instgs !== undefined);
  const ready = await frame.evaluate(() => window.instgs.ready);
  return { frame, holder, ready };
}

/** Compares the scene's picture with that of the program, from the first and the last training view. */
async function compareScene(browser, comparer) {
  const { page, close } = await opened(browser, DESKTOP);
  const { frame, holder, ready } = await sceneOf(page);
  const all = JSON.parse(fs.readFileSync(path.join(run, "cameras.json"), "utf8"));
  const cameras = [all[0], all[all.length - 1]].map((camera, i) => ({ ...camera, name: `view${i}` }));
  const ours = renderedBy(program, path.join(run, "scene.instgs"), cameras, folder);
  // At whole pixels: elsewhere the browser would scale the picture a little.
  const place = (css) => holder.evaluate((element, to) => { element.style.cssText = to; }, css);
  await place("position: fixed; left: 0; top: 0; border-radius: 0");
  const shown = [];
  for (const camera of cameras) {
    await frame.evaluate((of) => window.instgs.setCamera(of), camera);
    shown.push(await frame.locator("#picture").screenshot());
  }
  const values = [await psnr(comparer, ours[0], shown[0]), await psnr(comparer, ours[1], shown[1])];
  values.forEach((value, i) => {
    check(value >= LEAST_PSNR_DB, `view ${i} of the scene: ${value.toFixed(2)} dB is below ${LEAST_PSNR_DB}`);
  });
  // A picture of another view must not pass.
  check((await psnr(comparer, ours[1], shown[0])) < LEAST_PSNR_DB, "the pictures of two views are alike: they prove nothing");
  await frame.evaluate(() => window.instgs.setCamera(null));
  await place("");
  await useScene(page, frame);
  await close();
  return { ready, values };
}

/** The wheel is the report's until the scene is clicked; dragging turns the scene, and it can fill the screen. */
async function useScene(page, frame) {
  const camera = () => frame.evaluate(async () => JSON.stringify(await window.instgs.camera()));
  const scrolled = () => page.evaluate(() => window.scrollY);
  const box = await page.locator("iframe.scene").boundingBox();
  const [x, y] = [box.x + 0.3 * box.width, box.y + 0.5 * box.height];
  await page.mouse.move(x, y);
  const [first, top] = [await camera(), await scrolled()];
  await page.mouse.wheel(0, 40);
  await page.waitForFunction((before) => window.scrollY !== before, top);
  check((await camera()) === first, "the wheel moves the scene before it is clicked");
  await page.evaluate((to) => window.scrollTo(0, to), top);
  await page.mouse.click(x, y);
  await page.mouse.wheel(0, 40);
  await frame.waitForFunction(async (before) => JSON.stringify(await window.instgs.camera()) !== before, first);
  check((await scrolled()) === top, "the wheel scrolls the report after the scene was clicked");
  const zoomed = await camera();
  await page.mouse.down();
  await page.mouse.move(x + 60, y + 20, { steps: 4 });
  await page.mouse.up();
  check((await camera()) !== zoomed, "dragging does not turn the scene");
  await frame.locator("#full").click();
  await page.waitForFunction(() => document.fullscreenElement?.className === "scene");
  await frame.locator("#full").click();
  await page.waitForFunction(() => document.fullscreenElement === null);
}

/** Where the divider is, as a part of the pictures' width, and what the range says. */
const stateOf = (slider) => slider.evaluate((element) => {
  const [box, divider] = [element, element.querySelector(".divider")].map((of) => of.getBoundingClientRect());
  const range = element.querySelector("input");
  const at = (divider.left + divider.width / 2 - box.left) / box.width;
  const isFocused = document.activeElement === range;
  return { at, value: Number(range.value) / 100, text: range.getAttribute("aria-valuetext"), isFocused };
});

async function expectAt(slider, part, what) {
  const { at, value, text } = await stateOf(slider);
  const near = (a, b) => Math.abs(a - b) < 0.02;
  check(near(at, part) && near(value, part), `${what}: the divider is at ${at.toFixed(3)}, its range at ${value}, not at ${part}`);
  check(text === `${Math.round(100 * value)} % photograph`, `${what}: the range is read as ${text}`);
}

/** The pictures alone: without divider, and of one of them if named. */
const picturesOf = async (slider, only) => {
  const style = only ? `.slider img:not(${only}) { visibility: hidden } .slider .over { clip-path: none !important }` : "";
  return slider.screenshot({ style: `.divider { visibility: hidden } ${style}` });
};

async function useSlider(browser, comparer) {
  const { page, close } = await opened(browser, DESKTOP);
  const sliders = page.locator(".slider");
  const count = await sliders.count();
  check(count > 0, "the report compares no test view");
  const slider = sliders.first();
  await slider.scrollIntoViewIfNeeded();
  await expectAt(slider, 0.5, "at the start");
  const box = await slider.boundingBox();
  const x = (part) => box.x + part * box.width;
  const y = box.y + 0.4 * box.height;
  await page.mouse.move(x(0.2), y);
  await expectAt(slider, 0.5, "before a press");
  await page.mouse.down();
  await expectAt(slider, 0.2, "after a press");
  await page.mouse.move(x(0.7), y, { steps: 5 });
  await expectAt(slider, 0.7, "while the mouse drags");
  await page.mouse.move(x(1.4), y + 300, { steps: 3 });
  await expectAt(slider, 1, "beyond the edge");
  await page.mouse.up();
  await page.mouse.move(x(0.3), y);
  await expectAt(slider, 1, "after the release");
  check((await stateOf(slider)).isFocused, "the keys do not follow the pointer");
  const [photo, render] = [await picturesOf(slider, ":not(.over)"), await picturesOf(slider, ".over")];
  const expectPicture = async (want, what) => {
    const near = await psnr(comparer, want, await picturesOf(slider));
    check(near > SAME_PSNR_DB, `${what} is not what is seen (${near.toFixed(1)} dB)`);
  };
  check((await psnr(comparer, photo, render)) < SAME_PSNR_DB, "photo and rendering are the same picture");
  await expectPicture(photo, "at the right edge the photo");
  await page.keyboard.press("Home");
  await expectAt(slider, 0, "after the key Home");
  await expectPicture(render, "at the left edge the rendering");
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowRight");
  await expectAt(slider, 0.02, "after two presses of an arrow key");
  await page.keyboard.press("PageUp");
  await expectAt(slider, 0.12, "after the key PageUp");
  const names = await sliders.locator("img").evaluateAll((images) => images.map((image) => image.alt));
  check(names.length === 2 * count && names.every((name) => /: (photograph|rendering)$/.test(name)), `alt texts: ${names}`);
  await close();
  return count;
}

/** A finger that moves sideways moves the divider; one that moves up scrolls the page. */
async function touchSlider(browser) {
  const { page, close } = await opened(browser, PHONE);
  const slider = page.locator(".slider").first();
  await slider.scrollIntoViewIfNeeded();
  await page.evaluate(() => document.querySelector(".slider").scrollIntoView({ block: "center" }));
  const box = await slider.boundingBox();
  const session = await page.context().newCDPSession(page);
  const swipe = async (from, to) => {
    const at = (part) => ({ x: from.x + part * (to.x - from.x), y: from.y + part * (to.y - from.y) });
    await session.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: [at(0)] });
    for (let i = 1; i <= 8; i++) await session.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: [at(i / 8)] });
    await session.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
  };
  const y = box.y + 0.6 * box.height;
  const top = await page.evaluate(() => window.scrollY);
  await swipe({ x: box.x + 0.5 * box.width, y }, { x: box.x + 0.8 * box.width, y });
  await expectAt(slider, 0.8, "after a finger's swipe");
  check((await page.evaluate(() => window.scrollY)) === top, "a swipe along the slider scrolls the page");
  await swipe({ x: box.x + 0.8 * box.width, y }, { x: box.x + 0.8 * box.width, y: y - 200 });
  await page.waitForFunction((before) => window.scrollY > before + 50, top);
  await expectAt(slider, 0.8, "after a swipe upwards");
  const [wide, view] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]);
  check(wide <= view, `the page is ${wide} pixels wide on a phone of ${view}`);
  await close();
}

async function withoutScripts(browser) {
  const { page, close } = await opened(browser, { ...DESKTOP, javaScriptEnabled: false });
  const images = page.locator(".trio[data-view]").first().locator("img");
  await images.first().scrollIntoViewIfNeeded();
  const boxes = [await images.nth(0).boundingBox(), await images.nth(1).boundingBox()];
  const beside = boxes[0].x + boxes[0].width <= boxes[1].x && Math.abs(boxes[0].y - boxes[1].y) < 1;
  const isWhole = (await images.count()) === 3 && boxes[0].width > 200;
  check(isWhole && beside, "without scripts photo and rendering do not stand side by side");
  await close();
}

async function takeShots(browser, to) {
  fs.mkdirSync(to, { recursive: true });
  for (const { name, options } of looks()) {
    const { page, close } = await opened(browser, options);
    const { holder } = await sceneOf(page);
    await page.evaluate(() => window.scrollTo(0, 0));
    await page.screenshot({ path: path.join(to, `${name}.png`) });
    await holder.evaluate((element) => element.scrollIntoView({ block: "center" }));
    await page.screenshot({ path: path.join(to, `${name}_scene.png`) });
    await page.evaluate(() => document.querySelector(".slider").closest(".view").scrollIntoView());
    await page.screenshot({ path: path.join(to, `${name}_sliders.png`) });
    await close();
  }
}

(async () => {
  const browser = await startBrowser();
  try {
    const comparer = await browser.newPage();
    const { ready, values } = await compareScene(browser, comparer);
    const sliders = await useSlider(browser, comparer);
    await touchSlider(browser);
    await withoutScripts(browser);
    if (process.env.SHOTS) await takeShots(browser, process.env.SHOTS);
    const [bytes, shown] = [fs.statSync(file).size, values.map((value) => value.toFixed(2)).join(", ")];
    console.log(`check_report: ${bytes} bytes, the scene's first picture after ${Math.round(ready)} ms, PSNR ${shown} dB, ` +
      `${sliders} sliders`);
  } finally {
    await browser.close();
  }
  failures.forEach((failure) => console.error(`check_report: ${failure}`));
  process.exit(failures.length > 0 ? 1 : 0);
})();
