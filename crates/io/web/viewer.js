// The picture: what is shown of the scene from where, and when it is drawn and sorted anew.

import { Camera, viewOf } from "./camera.js";

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
   */
  constructor(canvas, worker, scene, start, renderer) {
    this.canvas = canvas;
    this.worker = worker;
    this.scene = scene;
    this.renderer = renderer;
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
    /** @type {(() => void)[]} */
    this.waiting = [];
    /** @type {(() => void)[]} called before each frame; they may move the camera */
    this.beforeFrame = [];
    this.sortedKey = "";
    this.isSorting = false;
    this.isScheduled = false;
    worker.onmessage = (event) => this.receive(event.data);
    new ResizeObserver(() => this.invalidate()).observe(canvas);
    this.invalidate();
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
    if (this.isScheduled) return;
    this.isScheduled = true;
    requestAnimationFrame(() => {
      this.isScheduled = false;
      this.beforeFrame.forEach((before) => before());
      const camera = this.cameraFile();
      this.renderer.draw(camera);
      this.sortIfNeeded(camera);
    });
  }

  /** @param {import("./camera.js").CameraFile} camera */
  async sortIfNeeded(camera) {
    const view = viewOf(camera, this.scene.near);
    const key = `${view.view.slice(8)} ${this.shownRows}`;
    if (this.isSorting) return;
    if (this.renderer.sortsItself || key === this.sortedKey) {
      this.waiting.splice(0).forEach((resolve) => resolve());
      return;
    }
    this.isSorting = true;
    const buffer = this.spare;
    this.spare = undefined;
    const answer = await this.ask({ sort: view, shown: this.shownRows, buffer }, buffer ? [buffer.buffer] : []);
    this.renderer.setOrder(answer.order, answer.count);
    this.spare = answer.order;
    this.sortedKey = key;
    this.isSorting = false;
    this.invalidate();
  }

  /** Resolves once the picture shows what was asked for so far. */
  settled() {
    return new Promise((/** @type {(value?: unknown) => void} */ resolve) => {
      this.waiting.push(resolve);
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
   * Shows one camera as it is, at its own size; null gives the camera back to the user.
   * @param {import("./camera.js").CameraFile | null} camera
   */
  setFixed(camera) {
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
