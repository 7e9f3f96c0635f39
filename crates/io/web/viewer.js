// The picture: what is shown of the scene from where, and when it is drawn and sorted anew.

import { Camera, viewOf, wholeCamera } from "./camera.js";

/** Largest number of canvas pixels per CSS pixel: more costs time, and is hardly seen. */
const MOST_PIXEL_RATIO = 2;
/** Brightness of the rest while something is selected. */
const DIMMED = 0.4;

/** How an object looks. @typedef {{shown: boolean, tint: number[] | null}} Look */
/** The background's number among objects; instances count from 0. */
export const BACKGROUND = -1;

export class Viewer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Worker} worker
   * @param {any} scene the worker's answer
   * @param {import("./camera.js").Start} start
   * @param {import("./renderer.js").Renderer | import("./gpu_renderer.js").GpuRenderer} renderer
   * @param {(error: unknown) => void} tell of a fault after which there are no more pictures
   */
  constructor(canvas, worker, scene, start, renderer, tell) {
    this.canvas = canvas;
    this.worker = worker;
    this.scene = scene;
    this.renderer = renderer;
    this.tell = tell;
    this.camera = new Camera(start, scene.near);
    /** @type {import("./camera.js").CameraFile | null} a camera that is shown as it is, at its own size */
    this.fixed = null;
    /** @type {Map<number, Look>} */
    this.looks = new Map([BACKGROUND, ...scene.names.keys()].map((object) => [object, { shown: true, tint: null }]));
    /** @type {Set<number>} */
    this.selected = new Set();
    this.shownRows = new Uint8Array(scene.rows.length).fill(1);
    this.nextId = 1;
    /** @type {Map<number, {resolve: (answer: any) => void, reject: (error: Error) => void}>} */
    this.asked = new Map();
    /** @type {{resolve: (value?: unknown) => void, reject: (error: unknown) => void}[]} */
    this.waiting = [];
    /** What has gone wrong for good, if anything has. @type {Error | null} */
    this.fault = null;
    /** @type {(() => void)[]} called before each frame; they may move the camera */
    this.beforeFrame = [];
    this.sortedKey = "";
    this.isSorting = false;
    this.isScheduled = false;
    worker.onmessage = (event) => this.receive(event.data);
    worker.onerror = (event) => this.fail(event.message || "the worker has stopped");
    worker.onmessageerror = () => this.fail("the worker's answer cannot be read");
    new ResizeObserver(() => this.invalidate()).observe(canvas);
    this.followPixelRatio();
    this.invalidate();
  }

  /** Draws anew on a screen of other pixels: the canvas keeps its size there, so that nothing else tells of it. */
  followPixelRatio() {
    // Kept here: some browsers forget a list that nothing holds, with its listeners.
    this.asNow = matchMedia(`(resolution: ${window.devicePixelRatio || 1}dppx)`);
    this.asNow.addEventListener("change", () => {
      this.invalidate();
      this.followPixelRatio();
    }, { once: true });
  }

  /**
   * Ends it: tells the user, and whoever waits for a picture or an answer.
   * @param {unknown} error
   */
  fail(error) {
    if (this.fault) return;
    this.fault = error instanceof Error ? error : new Error(String(error));
    this.tell(this.fault);
    [...this.waiting.splice(0), ...this.asked.values()].forEach(({ reject }) => reject(this.fault));
    this.asked.clear();
  }

  /** The camera of the next frame. */
  cameraFile() {
    if (this.fixed) return this.fixed;
    const ratio = Math.min(MOST_PIXEL_RATIO, window.devicePixelRatio || 1);
    const side = (/** @type {number} */ css) => Math.max(1, Math.round(css * ratio));
    return this.camera.file(side(this.canvas.clientWidth), side(this.canvas.clientHeight));
  }

  /** Something has changed: draws soon. */
  invalidate() {
    if (this.isScheduled || this.fault) return;
    this.isScheduled = true;
    requestAnimationFrame(() => {
      this.isScheduled = false;
      this.frame().catch((error) => this.fail(error));
    });
  }

  async frame() {
    this.beforeFrame.forEach((before) => before());
    const camera = this.cameraFile();
    this.renderer.draw(camera);
    await this.sortIfNeeded(camera);
  }

  /** @param {import("./camera.js").CameraFile} camera */
  async sortIfNeeded(camera) {
    const view = viewOf(camera, this.scene.near);
    const key = `${view.view.slice(8)} ${this.shownRows}`;
    if (this.isSorting) return;
    if (this.renderer.sortsItself || key === this.sortedKey) {
      this.waiting.splice(0).forEach(({ resolve }) => resolve());
      return;
    }
    this.isSorting = true;
    const buffer = this.spare;
    this.spare = undefined;
    try {
      const answer = await this.ask({ sort: view, shown: this.shownRows, buffer }, buffer ? [buffer.buffer] : []);
      this.renderer.setOrder(answer.order, answer.count);
      this.spare = answer.order;
      this.sortedKey = key;
    } finally {
      this.isSorting = false;
    }
    this.invalidate();
  }

  /** Resolves once the picture shows what was asked for so far; rejects if it never will. */
  settled() {
    return new Promise((/** @type {(value?: unknown) => void} */ resolve, reject) => {
      if (this.fault) return reject(this.fault);
      this.waiting.push({ resolve, reject });
      this.invalidate();
    });
  }

  /**
   * Asks the worker.
   * @param {object} message
   * @param {Transferable[]} transfer
   * @returns {Promise<any>}
   */
  ask(message, transfer = []) {
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      if (this.fault) return reject(this.fault);
      this.asked.set(id, { resolve, reject });
      this.worker.postMessage({ id, ...message }, transfer);
    });
  }

  /** @param {any} answer */
  receive(answer) {
    const asked = this.asked.get(answer.id);
    this.asked.delete(answer.id);
    if (answer.error) asked?.reject(new Error(answer.error));
    else asked?.resolve(answer);
  }

  /**
   * What a place of the picture shows: the object and a point on it; null where nothing is.
   * @param {number} x CSS pixels from the left of the canvas
   * @param {number} y
   * @returns {Promise<{object: number, point: [number, number, number]} | null>}
   */
  async pick(x, y) {
    const camera = this.cameraFile();
    const ratio = camera.width / this.canvas.clientWidth;
    const { picked } = await this.ask({ pick: viewOf(camera, this.scene.near), shown: this.shownRows, x: x * ratio, y: y * ratio });
    return picked && { object: this.scene.rows[picked.row].owner, point: picked.point };
  }

  /** @param {Iterable<number>} objects */
  select(objects) {
    this.selected = new Set(objects);
    this.applyLooks();
  }

  /**
   * @param {Iterable<number>} objects
   * @param {Partial<Look>} look
   */
  setLook(objects, look) {
    for (const object of objects) {
      const before = this.looks.get(object);
      if (before) this.looks.set(object, { ...before, ...look });
    }
    this.applyLooks();
  }

  applyLooks() {
    this.scene.rows.forEach((/** @type {import("./scene.js").Row} */ row, /** @type {number} */ r) => {
      const look = this.looks.get(row.owner) ?? { shown: true, tint: null };
      const tint = look.tint ? [...look.tint, 1] : [0, 0, 0, 0];
      this.shownRows[r] = Number(look.shown);
      this.renderer.setLook(r, { shown: look.shown, selected: this.selected.has(row.owner), tint });
    });
    this.renderer.dim = this.selected.size > 0 ? DIMMED : 1;
    this.invalidate();
  }

  /**
   * Shows one camera as it is, at its own size; null gives the camera back to the user. Throws if it is no whole camera; then
   * all stays as it was.
   * @param {any} given
   */
  setFixed(given) {
    const camera = given === null ? null : wholeCamera(given);
    this.fixed = camera;
    this.canvas.style.width = camera ? `${camera.width}px` : "";
    this.canvas.style.height = camera ? `${camera.height}px` : "";
    document.body.classList.toggle("fixed", camera !== null);
    return this.settled();
  }

  /** @param {number[]} rgb 0 to 1 */
  setBackground(rgb) {
    this.renderer.background = rgb;
    this.invalidate();
  }
}
