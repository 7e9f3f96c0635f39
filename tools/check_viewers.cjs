// The part of tools/check_viewers that drives the browser: PROGRAM FOLDER [SCENE CAMERAS].
"use strict";
const { execFileSync } = require("child_process");
const fs = require("fs");
const path = require("path");
const { psnr, startBrowser } = require("./browser/browser.cjs");
const { ENGINES } = require("./browser/engines.cjs");
const { smallestScene, tinyCameras, tinyScene } = require("./browser/tiny_scene.cjs");

const ORIGIN = "http://viewers.test";
const VIEWS = 3;
/** Between two looks at a picture; one that does not change for three looks is done. */
const LOOK_MS = 400;
/** A worker sorts, and a picture in the old order does not change either: one that is too far from ours is looked at again. */
const LOOKS = 25;

const [program, folder, scene, camerasFile] = process.argv.slice(2);
const at = (name) => path.join(folder, name);
const failures = [];

function instgs(...args) {
  return execFileSync(program, args, { stdio: ["ignore", "pipe", "inherit"], encoding: "utf8" });
}

/** A scene's files, instances as nodes and all in one mesh, and our pictures of the former. */
function prepare({ name, from, cameras, hasBackground }) {
  const files = { instances: at(`${name}.glb`), "one mesh": at(`${name}.one.glb`) };
  instgs("export", "--scene", from, "--to", files.instances);
  instgs("export", "--scene", from, "--to", files["one mesh"], "--one-mesh");
  const list = at(`${name}.cameras.json`);
  fs.writeFileSync(list, JSON.stringify(cameras));
  instgs("render", "--scene", files.instances, "--camera", list, "--out", at(name));
  const views = cameras.map((camera) => ({ camera, png: fs.readFileSync(path.join(at(name), `${camera.name}.png`)) }));
  return { name, files, views, hasBackground };
}

/** The scene of the arguments, or balls with and without a floor, made here. */
function scenes() {
  if (scene) {
    const all = [].concat(JSON.parse(fs.readFileSync(camerasFile, "utf8")));
    const step = Math.max(1, Math.ceil(all.length / VIEWS));
    const cameras = all.filter((_, i) => i % step === 0).map((camera, i) => ({ ...camera, name: `view${i}` }));
    return [prepare({ name: "scene", from: scene, cameras, hasBackground: true })];
  }
  const made = [
    { name: "balls", bytes: tinyScene(false), instances: 4, hasBackground: false },
    { name: "balls on a floor", bytes: tinyScene(true), instances: 4, hasBackground: true },
    { name: "four Gaussians", bytes: smallestScene(), instances: 2, hasBackground: true },
  ];
  return made.map(({ name, bytes, instances, hasBackground }) => {
    const file = at(`${name}.made.glb`);
    fs.writeFileSync(file, bytes);
    const from = at(`${name}.instgs`);
    instgs("export", "--scene", file, "--to", from);
    const read = JSON.parse(instgs("inspect", from, "--json")).gaussians.instances;
    if (read !== instances) failures.push(`${name}: ${read} instances instead of ${instances}`);
    return prepare({ name, from, cameras: tinyCameras(), hasBackground });
  });
}

/** A page in which the engine shows the file; warnings and errors of its console fail the check. */
async function opened(browser, engine, file, viewport) {
  const page = await browser.newPage({ viewport });
  const say = (text) => failures.push(`${engine.name}: ${text}`);
  page.on("console", (message) => ["warning", "error"].includes(message.type()) && say(message.text()));
  page.on("pageerror", (error) => say(error.message));
  const tags = engine.scripts.map((_, i) => `<script src="/${i}.js"></script>`).join("");
  const style = "<style>body{margin:0}canvas{display:block;outline:none}</style>";
  const scripts = engine.scripts.map((script, i) => [`/${i}.js`, ["text/javascript", fs.readFileSync(require.resolve(script))]]);
  const bodies = {
    "/": ["text/html", `<!doctype html><link rel="icon" href="data:,">${style}<canvas></canvas>${tags}`],
    "/scene.glb": ["model/gltf-binary", fs.readFileSync(file)],
    ...Object.fromEntries(scripts),
  };
  await page.route("**/*", (route) => {
    const found = bodies[new URL(route.request().url()).pathname];
    return found ? route.fulfill({ contentType: found[0], body: found[1] }) : route.abort();
  });
  await page.goto(`${ORIGIN}/`);
  await page.evaluate(engine.start);
  return page;
}

/** The engine's picture of a camera and its PSNR beside ours, once it is done. */
async function pictureOf(page, comparer, { camera, png }, leastPsnr) {
  await page.evaluate((of) => window.showCamera(of), camera);
  const looks = [];
  let value = -1;
  while (looks.length < LOOKS && value < leastPsnr) {
    await page.waitForTimeout(LOOK_MS);
    looks.unshift(await page.locator("canvas").screenshot());
    const still = looks.length > 2 && looks[0].equals(looks[1]) && looks[0].equals(looks[2]);
    if (still) value = await psnr(comparer, png, looks[0]);
  }
  return { value, picture: looks[0] };
}

/** PSNR of every view in an engine, dB. */
async function compare(browser, comparer, engine, { name, files, views }, kind) {
  const { width, height } = views[0].camera;
  const page = await opened(browser, engine, files[kind], { width, height });
  const values = [];
  // PlayCanvas may keep the order of a camera that is set while the file is new until that camera moves.
  await pictureOf(page, comparer, views.at(-1), 0);
  for (const view of views) {
    const { value, picture } = await pictureOf(page, comparer, view, engine.leastPsnr);
    values.push(value);
    if (process.env.SHOTS) {
      const save = (who, png) => fs.writeFileSync(path.join(process.env.SHOTS, `${name}, ${view.camera.name}, ${who}.png`), png);
      fs.mkdirSync(process.env.SHOTS, { recursive: true });
      save("ours", view.png);
      save(`${engine.name}, ${kind}`, picture);
    }
  }
  await page.close();
  return values;
}

/** Compares one file in one engine, prints a line, and notes what fails. */
async function check(browser, comparer, engine, prepared, kind) {
  const values = await compare(browser, comparer, engine, prepared, kind);
  const holds = values.every((value) => value >= engine.leastPsnr);
  const text = `${engine.name}, ${prepared.name}, ${kind}: ${values.map((value) => value.toFixed(2)).join(", ")} dB`;
  const mayHide = !engine.sortsAll && prepared.hasBackground && kind === "instances";
  if (mayHide) {
    const said = holds ? "the background hides nothing here" : "the background hides objects, since the engine orders whole meshes";
    console.log(`check_viewers: ${text} (${said})`);
    return;
  }
  console.log(`check_viewers: ${text}`);
  if (!holds) failures.push(`${text} is below ${engine.leastPsnr}`);
}

(async () => {
  const all = scenes();
  const browser = await startBrowser();
  try {
    const comparer = await browser.newPage();
    for (const prepared of all) {
      // A picture of another view must not pass.
      const [one, two] = prepared.views;
      const wrong = two ? await psnr(comparer, one.png, two.png) : 0;
      if (wrong >= Math.min(...ENGINES.map(({ leastPsnr }) => leastPsnr))) failures.push(`${prepared.name}: two views are alike`);
      for (const engine of ENGINES) {
        for (const kind of Object.keys(prepared.files)) await check(browser, comparer, engine, prepared, kind);
      }
    }
  } finally {
    await browser.close();
  }
  failures.forEach((failure) => console.error(`check_viewers: ${failure}`));
  process.exit(failures.length > 0 ? 1 : 0);
})();
