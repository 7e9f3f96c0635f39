// Starts the page, and connects its parts. Programs find it as `window.instgs` (docs/page.md).

import { Controls } from "./controls.js";
import { GpuRenderer } from "./gpu_renderer.js";
import { Panel, byId, grouped, rgbOf } from "./panel.js";
import { Renderer } from "./renderer.js";
import { BACKGROUND, Viewer } from "./viewer.js";

const THEME_KEY = "instgs-theme";
/** Whether another page holds this one as a frame: a report. That page then has the theme, and the wheel scrolls it. */
const IS_FRAMED = window.parent !== window;

/** @param {string} id */
const textOf = (id) => byId(id).textContent ?? "";

/** The worker, from the text that the page holds. */
function startWorker() {
  const url = URL.createObjectURL(new Blob([textOf("worker-source")], { type: "text/javascript" }));
  const worker = new Worker(url);
  URL.revokeObjectURL(url);
  return worker;
}

/**
 * The scene, unpacked by the worker.
 * @param {Worker} worker
 * @returns {Promise<any>}
 */
function unpacked(worker) {
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => (data.error ? reject(new Error(data.error)) : resolve(data.scene));
    worker.onerror = (event) => reject(new Error(event.message || "the worker did not start"));
    const data = byId("scene-data");
    worker.postMessage({ load: (data.textContent ?? "").trim() });
    // The text is no longer needed.
    data.textContent = "";
  });
}

/** The camera of `#camera=JSON`, for pictures of a given view; null if the address has none. */
function cameraOfHash() {
  const found = /^#camera=(.*)$/.exec(location.hash);
  if (!found) return null;
  try {
    return JSON.parse(decodeURIComponent(found[1])) ?? {};
  } catch (error) {
    throw new Error("the camera after # in the address is no URI-encoded JSON", { cause: error });
  }
}

/** @param {any} scene */
function showFacts(scene) {
  const [instances, templates] = [scene.names.length, scene.templateCounts.length];
  const facts = [`${grouped(scene.count)} Gaussians`];
  const plural = (/** @type {number} */ count, /** @type {string} */ what) => `${grouped(count)} ${what}${count === 1 ? "" : "s"}`;
  if (instances) facts.unshift(plural(instances, "instance"), plural(templates, "template"));
  byId("facts").textContent = facts.join(" · ");
}

/**
 * Buttons that are not about objects.
 * @param {Viewer} viewer
 * @param {Controls} controls
 */
function connectTools(viewer, controls) {
  const fly = byId("fly");
  fly.addEventListener("click", () => {
    controls.isFlying = !controls.isFlying;
    fly.setAttribute("aria-pressed", String(controls.isFlying));
  });
  byId("reset").addEventListener("click", () => {
    viewer.camera.reset();
    viewer.invalidate();
  });
  byId("theme").addEventListener("click", () => {
    const isDark = getComputedStyle(document.documentElement).colorScheme === "dark";
    setTheme(isDark ? "light" : "dark");
  });
  connectFullScreen();
  byId("fold-panel").addEventListener("click", () => foldPanel(!document.body.classList.contains("folded")));
  const background = /** @type {HTMLInputElement} */ (byId("background"));
  background.addEventListener("input", () => viewer.setBackground(rgbOf(background.value)));
  byId("save").addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([viewer.scene.file], { type: "application/octet-stream" }));
    link.download = `${document.title}.instgs`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
}

/** The button for the whole screen, where the browser has that. */
function connectFullScreen() {
  const full = byId("full");
  full.hidden = !document.fullscreenEnabled;
  full.addEventListener("click", () => {
    // It may be refused; then the page stays as it is.
    const change = document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
    change.catch(() => {});
  });
  document.addEventListener("fullscreenchange", () => {
    full.setAttribute("aria-pressed", String(document.fullscreenElement !== null));
  });
}

/** @param {boolean} isFolded */
function foldPanel(isFolded) {
  document.body.classList.toggle("folded", isFolded);
  byId("fold-panel").setAttribute("aria-expanded", String(!isFolded));
}

/** Folds the panel where there is no room for it, until it is folded by hand. A frame has no width yet when its page starts. */
function foldWhereNarrow() {
  const narrow = matchMedia("(max-width: 700px)");
  const follow = () => foldPanel(narrow.matches);
  narrow.addEventListener("change", follow);
  byId("fold-panel").addEventListener("click", () => narrow.removeEventListener("change", follow), { once: true });
  follow();
}

/** @param {string} theme */
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try {
    localStorage.setItem(THEME_KEY, theme);
  } catch {
    // Pages from a file may have no storage; the theme then lasts as long as the page.
  }
}

/** The theme that was chosen here before, else the browser's; in a frame always the browser's, as the page around it. */
function restoreTheme() {
  let chosen = null;
  try {
    chosen = IS_FRAMED ? null : localStorage.getItem(THEME_KEY);
  } catch {
    // As above.
  }
  const isDark = matchMedia("(prefers-color-scheme: dark)");
  const show = () => document.documentElement.dataset.theme = chosen ?? (isDark.matches ? "dark" : "light");
  if (IS_FRAMED) isDark.addEventListener("change", show);
  show();
}

/**
 * What a click, a double click and a key do.
 * @param {Viewer} viewer
 * @param {Panel} panel
 * @returns {import("./controls.js").Handlers}
 */
function handlersOf(viewer, panel) {
  /** @typedef {Awaited<ReturnType<Viewer["pick"]>>} Picked */
  const onPick = (/** @type {(picked: Picked) => void} */ act) => (/** @type {number} */ x, /** @type {number} */ y) => {
    // Without the panel nobody could take a selection back.
    if (!viewer.fixed) viewer.pick(x, y).then(act).catch((error) => viewer.fail(error));
  };
  return {
    click: onPick((picked) => panel.toggle(picked && picked.object !== BACKGROUND ? [picked.object] : [...viewer.selected])),
    doubleClick: onPick((picked) => {
      if (picked) viewer.camera.lookAt(picked.point);
      viewer.invalidate();
    }),
    key: (code) => {
      if (code === "Escape") panel.toggle([...viewer.selected]);
      if (code === "KeyH") panel.hideSelected();
      if (code === "KeyR") byId("reset").click();
      if (code === "KeyF") byId("fly").click();
    },
  };
}

/** @param {unknown} error */
function fail(error) {
  const status = byId("status");
  status.textContent = `The scene cannot be shown: ${error instanceof Error ? error.message : String(error)}.`;
  status.hidden = false;
  status.classList.add("failed");
}

/**
 * Draws with WebGPU where there is, else with WebGL2.
 * @param {HTMLCanvasElement} canvas
 * @param {any} scene
 * @param {(error: unknown) => void} tell of a fault of the device
 */
async function rendererOf(canvas, scene, tell) {
  const lost = () => tell("the graphics card was lost; load the page again");
  // A shader's first line must be its version.
  const shaders = (/** @type {string[]} */ ...names) =>
    /** @type {any} */ (Object.fromEntries(names.map((name) => [name, textOf(name).trimStart()])));
  // What WebGPU cannot do here, WebGL2 may.
  const gpu = await GpuRenderer.create(canvas, scene, shaders("project-wgsl", "sort-wgsl", "splats-wgsl")).catch(() => null);
  if (gpu) {
    gpu.device.lost.then(lost);
    gpu.device.addEventListener("uncapturederror", (/** @type {any} */ { error }) => tell(error.message));
    return gpu;
  }
  canvas.addEventListener("webglcontextlost", lost);
  return new Renderer(canvas, scene, shaders("project-frag", "quad-vert", "quad-frag", "screen-vert", "screen-frag"));
}

async function start() {
  document.body.classList.toggle("in-frame", IS_FRAMED);
  restoreTheme();
  foldWhereNarrow();
  const worker = startWorker();
  const scene = await unpacked(worker);
  const canvas = /** @type {HTMLCanvasElement} */ (byId("picture"));
  let tell = fail;
  const renderer = await rendererOf(canvas, scene, (error) => tell(error));
  const viewer = new Viewer(canvas, worker, scene, JSON.parse(textOf("start-data")), renderer, fail);
  tell = (error) => viewer.fail(error);
  const panel = new Panel(viewer);
  const controls = new Controls(viewer, handlersOf(viewer, panel), IS_FRAMED);
  connectTools(viewer, controls);
  showFacts(scene);
  const fixed = cameraOfHash();
  await (fixed === null ? viewer.settled() : viewer.setFixed(fixed));
  await viewer.renderer.finish();
  byId("status").hidden = true;
  return { viewer, panel };
}

const started = start();
started.catch(fail);
/** For programs; docs/page.md says what each does. */
Object.assign(window, {
  instgs: {
    ready: started.then(() => performance.now()),
    setCamera: async (/** @type {any} */ camera) => (await started).viewer.setFixed(camera),
    camera: async () => (await started).viewer.cameraFile(),
    drawsWith: async () => ((await started).viewer.renderer.sortsItself ? "webgpu" : "webgl2"),
    pick: async (/** @type {number} */ x, /** @type {number} */ y) => (await (await started).viewer.pick(x, y))?.object ?? null,
    objects: async () => {
      const { viewer } = await started;
      const hidden = [...viewer.looks].filter(([, look]) => !look.shown).map(([object]) => object);
      return { names: viewer.scene.names, selected: [...viewer.selected], hidden };
    },
    select: async (/** @type {number[]} */ objects) => {
      const { viewer, panel } = await started;
      viewer.select(objects);
      panel.refresh();
      await viewer.settled();
    },
    setLook: async (/** @type {number[]} */ objects, /** @type {any} */ look) => {
      const { viewer, panel } = await started;
      viewer.setLook(objects, look);
      panel.refresh();
      await viewer.settled();
    },
  },
});
