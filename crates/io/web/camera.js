// The camera: where it is, where it looks, and how it moves. OpenCV axes: x right, y down, z forward.

import { cross, dot, lengthOf, minus, plus, times, turned, unit } from "./linear.js";

/** @typedef {import("./linear.js").Vec3} Vec3 */
/**
 * A camera as `instgs-vk render --camera` reads it.
 * @typedef {{name?: string, width: number, height: number, fx: number, fy: number, cx: number, cy: number,
 *   view_from_world: number[][]}} CameraFile
 */
/**
 * What the page knows of the scene's place, written by the exporter: a training camera if there is one, and the circle that
 * `instgs-vk render --orbit` would take.
 * @typedef {{camera: CameraFile | null, center: Vec3, distance: number, up: Vec3}} Start
 */

const FIELD_OF_VIEW = (50 * Math.PI) / 180;
const ELEVATION = (20 * Math.PI) / 180;
/** Least angle between the view and the vertical. */
const LEAST_TILT = 0.02;
/** A view nearer to the vertical than this has no horizon: what lies at its right is then that of its camera. */
const NEARLY_VERTICAL = (5 * Math.PI) / 180;
/** Largest side of a picture, pixels, as `instgs-vk render` has it. */
const MOST_SIDE = 16384;

export class Camera {
  /**
   * @param {Start} start
   * @param {number} near depth of the near plane, scene units
   */
  constructor(start, near) {
    this.start = start;
    this.near = near;
    this.up = unit(start.up);
    /** @type {Vec3} */
    this.position = [0, 0, 0];
    /** @type {Vec3} */
    this.forward = [0, 0, 1];
    /** What it turns about is this far ahead. */
    this.distance = start.distance;
    /** Tangent of half the angle of view, by the geometric mean of the sides. */
    this.halfTangent = 1;
    this.reset();
  }

  /** Back to where it began. */
  reset() {
    const { camera, center, distance } = this.start;
    if (camera) {
      const [x, y, z] = camera.view_from_world;
      const eye = [0, 1, 2].map((k) => -(x[k] * x[3] + y[k] * y[3] + z[k] * z[3]));
      this.position = [eye[0], eye[1], eye[2]];
      this.look(unit([z[0], z[1], z[2]]), unit([x[0], x[1], x[2]]), NEARLY_VERTICAL);
      const ahead = dot(minus(center, this.position), this.forward);
      this.distance = ahead > this.near ? ahead : distance;
      this.halfTangent = 0.5 * Math.sqrt((camera.width * camera.height) / (camera.fx * camera.fy));
      return;
    }
    const side = unit(cross(this.up, Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    const front = cross(side, this.up);
    const back = plus(times(front, Math.cos(ELEVATION)), times(this.up, Math.sin(ELEVATION)));
    this.position = plus(center, times(back, distance));
    this.forward = times(back, -1);
    this.distance = distance;
    this.halfTangent = 1.2 * Math.tan(0.5 * FIELD_OF_VIEW);
  }

  /**
   * Looks along a direction, which becomes one that is not vertical: nearer to that than an angle, it turns about the vertical
   * until `right` lies at its right.
   * @param {Vec3} forward unit vector
   * @param {Vec3} right unit vector across it
   * @param {number} angle radians
   */
  look(forward, right, angle) {
    this.forward = forward;
    const sine = lengthOf(cross(forward, this.up));
    if (sine > Math.sin(angle)) return;
    const ahead = unit(cross(this.up, minus(right, times(this.up, dot(right, this.up)))));
    const tilt = Math.max(LEAST_TILT, Math.asin(sine));
    const upright = Math.sign(dot(forward, this.up)) * Math.cos(tilt);
    this.forward = plus(times(this.up, upright), times(ahead, Math.sin(tilt)));
  }

  /** Right, down and forward, unit vectors in the world; the horizon is level. */
  axes() {
    const right = unit(cross(this.forward, this.up));
    return { right, down: cross(this.forward, right), forward: this.forward };
  }

  get target() {
    return plus(this.position, times(this.forward, this.distance));
  }

  /**
   * Turns the view by angles to the right and up, radians.
   * @param {number} yaw
   * @param {number} pitch
   */
  turn(yaw, pitch) {
    const { right } = this.axes();
    const tilt = Math.acos(Math.min(1, Math.max(-1, dot(this.forward, this.up))));
    const wanted = Math.min(Math.PI - LEAST_TILT, Math.max(LEAST_TILT, tilt - pitch));
    this.forward = unit(turned(turned(this.forward, right, tilt - wanted), this.up, -yaw));
  }

  /**
   * Turns about the target, which stays where it is.
   * @param {number} yaw
   * @param {number} pitch
   */
  orbit(yaw, pitch) {
    const { target } = this;
    this.turn(yaw, pitch);
    this.position = minus(target, times(this.forward, this.distance));
  }

  /**
   * Moves along its own axes, scene units.
   * @param {number} right
   * @param {number} down
   * @param {number} forward
   */
  move(right, down, forward) {
    const axes = this.axes();
    const step = plus(plus(times(axes.right, right), times(axes.down, down)), times(axes.forward, forward));
    this.position = plus(this.position, step);
  }

  /**
   * Towards the target, or away from it.
   * @param {number} factor what becomes of the distance
   */
  zoom(factor) {
    const { target } = this;
    this.distance = Math.max(1e-3 * this.start.distance, this.distance * factor);
    this.position = minus(target, times(this.forward, this.distance));
  }

  /**
   * Looks at a point from where it is.
   * @param {Vec3} point
   */
  lookAt(point) {
    const to = minus(point, this.position);
    const distance = lengthOf(to);
    if (!(distance > this.near)) return;
    this.distance = distance;
    this.look(times(to, 1 / distance), this.axes().right, LEAST_TILT);
  }

  /**
   * The camera for a picture of this size.
   * @param {number} width pixels
   * @param {number} height
   * @returns {CameraFile}
   */
  file(width, height) {
    const focal = Math.sqrt(width * height) / (2 * this.halfTangent);
    const { right, down, forward } = this.axes();
    const row = (/** @type {Vec3} */ axis) => [...axis, -dot(axis, this.position)];
    const view_from_world = [row(right), row(down), row(forward), [0, 0, 0, 1]];
    return { name: "page", width, height, fx: focal, fy: focal, cx: width / 2, cy: height / 2, view_from_world };
  }
}

/**
 * The camera that a program gives: one, or a list of one or more, whose first counts.
 * @param {any} given
 * @returns {CameraFile}
 */
export function wholeCamera(given) {
  const camera = Array.isArray(given) ? given[0] : given;
  const fail = (/** @type {string} */ what) => new Error(`the camera is not whole: ${what}`);
  if (typeof camera !== "object" || camera === null) throw fail("it is no object of a camera file");
  for (const side of ["width", "height"]) {
    const is = camera[side];
    if (!(Number.isInteger(is) && is >= 1 && is <= MOST_SIDE)) throw fail(`${side} is no whole number from 1 to ${MOST_SIDE}`);
  }
  for (const focal of ["fx", "fy"]) {
    if (!(Number.isFinite(camera[focal]) && camera[focal] > 0)) throw fail(`${focal} is no number above 0`);
  }
  for (const centre of ["cx", "cy"]) if (!Number.isFinite(camera[centre])) throw fail(`${centre} is no number`);
  const rows = camera.view_from_world;
  const isRow = (/** @type {any} */ row) => Array.isArray(row) && row.length === 4 && row.every(Number.isFinite);
  const isMatrix = Array.isArray(rows) && rows.length === 4 && rows.every(isRow);
  if (!isMatrix) throw fail("view_from_world is no list of 4 rows of 4 numbers");
  const axes = rows.slice(0, 3);
  const isRigid = axes.every((a, i) => axes.every((b, j) => Math.abs(dot(a, b) - Number(i === j)) < 1e-3));
  if (!isRigid) throw fail("view_from_world is no rotation and translation");
  return camera;
}

/**
 * What the renderer and the worker take of a camera.
 * @param {CameraFile} camera
 * @param {number} near depth of the near plane, scene units
 * @returns {import("./pick.js").View & {position: Vec3}}
 */
export function viewOf(camera, near) {
  const rows = camera.view_from_world.slice(0, 3);
  const [x, y, z] = [0, 1, 2].map((k) => -rows.reduce((sum, row) => sum + row[k] * row[3], 0));
  return {
    view: rows.flat(),
    position: [x, y, z],
    focal: [camera.fx, camera.fy],
    principal: [camera.cx, camera.cy],
    size: [camera.width, camera.height],
    near,
  };
}
