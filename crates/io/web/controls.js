// Mouse, touch and keys.

/** A press that moves less than this, CSS pixels, is a click. */
const CLICK_PX = 5;
/** Radians per CSS pixel. */
const TURN_SPEED = 0.006;
/** Distances to the target per second of flight; with Shift as many times more. */
const FLY_SPEED = 0.6;
const FAST = 4;
const WHEEL_SPEED = 0.0012;
/** Radians per second of turning by keys. */
const KEY_TURN_SPEED = 1.2;
/** What becomes of the distance to the target with each press of + and -. */
const KEY_ZOOM = { "+": 0.9, "=": 0.9, "-": 1 / 0.9, "_": 1 / 0.9 };
/** Angles to the right and up that arrows stand for while Shift is held. */
const TURNS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
const DIRECTIONS = {
  KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyQ: [0, 1, 0], KeyE: [0, -1, 0],
  ArrowUp: [0, 0, 1], ArrowDown: [0, 0, -1], ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0],
};

/**
 * @typedef {{click: (x: number, y: number) => void, doubleClick: (x: number, y: number) => void,
 *   key: (code: string) => void}} Handlers
 */

export class Controls {
  /**
   * @param {import("./viewer.js").Viewer} viewer
   * @param {Handlers} handlers
   * @param {boolean} isFramed whether the wheel is another page's until the picture is clicked
   */
  constructor(viewer, handlers, isFramed) {
    this.viewer = viewer;
    this.handlers = handlers;
    this.isFramed = isFramed;
    /** Whether dragging turns the head instead of the scene. */
    this.isFlying = false;
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    this.travelled = 0;
    /** @type {Set<string>} */
    this.held = new Set();
    this.flownAt = 0;
    /** Whether Shift is held: keys move faster, and arrows turn. */
    this.isFast = false;
    this.listen(viewer.canvas);
    viewer.beforeFrame.push(() => this.fly());
  }

  /** @param {HTMLCanvasElement} canvas */
  listen(canvas) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => this.up(event, true));
    canvas.addEventListener("pointercancel", (event) => this.up(event, false));
    canvas.addEventListener("dblclick", (event) => this.handlers.doubleClick(event.offsetX, event.offsetY));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("keydown", (event) => this.keyDown(event));
    window.addEventListener("keyup", (event) => this.keyUp(event));
    window.addEventListener("blur", () => this.held.clear());
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.viewer.canvas.focus({ preventScroll: true });
    this.viewer.canvas.setPointerCapture(event.pointerId);
    if (this.pointers.size === 0) this.travelled = 0;
    // Two fingers are never a click.
    else this.travelled = Infinity;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  /**
   * @param {PointerEvent} event
   * @param {boolean} isWhole whether the press ended as presses do
   */
  up(event, isWhole) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (isWhole && this.pointers.size === 0 && this.travelled < CLICK_PX && event.button === 0) {
      this.handlers.click(event.offsetX, event.offsetY);
    }
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before || this.viewer.fixed) return;
    const now = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    this.travelled += Math.hypot(dx, dy);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    const { camera } = this.viewer;
    if (other) {
      const apart = (/** @type {{x: number, y: number}} */ p) => Math.max(1, Math.hypot(p.x - other.x, p.y - other.y));
      camera.zoom(apart(before) / apart(now));
      this.pan(0.5 * dx, 0.5 * dy);
    } else if (event.buttons & 6 || event.shiftKey) {
      this.pan(dx, dy);
    } else if (this.isFlying) {
      camera.turn(-0.5 * TURN_SPEED * dx, 0.5 * TURN_SPEED * dy);
    } else {
      camera.orbit(TURN_SPEED * -dx, TURN_SPEED * dy);
    }
    this.pointers.set(event.pointerId, now);
    this.viewer.invalidate();
  }

  /**
   * Moves so that the target stays under the pointer.
   * @param {number} dx CSS pixels
   * @param {number} dy
   */
  pan(dx, dy) {
    const { camera, canvas } = this.viewer;
    const { clientWidth: width, clientHeight: height } = canvas;
    const unitsPerPixel = (2 * camera.halfTangent * camera.distance) / Math.sqrt(width * height);
    camera.move(-dx * unitsPerPixel, -dy * unitsPerPixel, 0);
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    const isMine = document.hasFocus() && document.activeElement === this.viewer.canvas;
    if (this.isFramed && !isMine && !document.fullscreenElement) return;
    event.preventDefault();
    if (this.viewer.fixed) return;
    // Lines and pages, in pixels.
    const delta = event.deltaY * [1, 16, 400][event.deltaMode];
    this.zoom(Math.exp(delta * WHEEL_SPEED));
  }

  /** @param {KeyboardEvent} event */
  keyDown(event) {
    const at = event.target instanceof Element ? event.target : document.body;
    this.isFast = event.shiftKey;
    // What is released while Meta is held is told of by no event.
    if (event.metaKey) this.held.clear();
    // Nobody types into the field of a colour, where the focus stays after one was chosen; but Escape closes what it has opened.
    const isTyping = at.closest(event.code === "Escape" ? "input" : 'input:not([type="color"]), select, textarea');
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey || this.viewer.fixed) return;
    if (event.key in KEY_ZOOM) {
      event.preventDefault();
      this.zoom(KEY_ZOOM[/** @type {keyof typeof KEY_ZOOM} */ (event.key)]);
    } else if (event.code in DIRECTIONS && !(event.code.startsWith("Arrow") && at.closest("#panel"))) {
      event.preventDefault();
      if (this.held.size === 0) this.flownAt = performance.now();
      this.held.add(event.code);
      this.viewer.invalidate();
    } else if (!event.repeat) {
      this.handlers.key(event.code);
    }
  }

  /** @param {KeyboardEvent} event */
  keyUp(event) {
    // A press may be shorter than a frame.
    this.fly();
    this.held.delete(event.code);
    this.isFast = event.shiftKey;
    if (event.key === "Meta") this.held.clear();
  }

  /** Moves by what has been held down since it was last called. */
  fly() {
    if (this.held.size === 0) return;
    const now = performance.now();
    const seconds = Math.min(0.1, (now - this.flownAt) / 1000);
    this.flownAt = now;
    const { camera } = this.viewer;
    const step = seconds * FLY_SPEED * camera.start.distance * (this.isFast ? FAST : 1) * 0.5;
    for (const [code, [right, down, forward]] of Object.entries(DIRECTIONS)) {
      if (!this.held.has(code)) continue;
      if (this.isFast && code in TURNS) this.turn(TURNS[/** @type {keyof typeof TURNS} */ (code)], seconds * KEY_TURN_SPEED);
      else camera.move(step * right, step * down, step * forward);
    }
    this.viewer.invalidate();
  }

  /**
   * Turns the scene, or the head while flying.
   * @param {number[]} direction to the right and up
   * @param {number} angle radians
   */
  turn([right, up], angle) {
    const { camera } = this.viewer;
    if (this.isFlying) camera.turn(angle * right, angle * up);
    else camera.orbit(angle * right, angle * up);
  }

  /**
   * Towards the target, or away from it.
   * @param {number} factor what becomes of the distance
   */
  zoom(factor) {
    const { camera } = this.viewer;
    if (this.isFlying) camera.move(0, 0, -Math.log(factor) * camera.distance);
    else camera.zoom(factor);
    this.viewer.invalidate();
  }
}
