// Vectors of three numbers, for cameras.

/**
 * @typedef {[number, number, number]} Vec3
 */

/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @type {(a: Vec3, s: number) => Vec3} */
export const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
/** @type {(a: Vec3, b: Vec3) => number} */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @type {(a: Vec3, b: Vec3) => Vec3} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @type {(a: Vec3) => number} */
export const lengthOf = (a) => Math.sqrt(dot(a, a));
/** @type {(a: Vec3) => Vec3} */
export const unit = (a) => times(a, 1 / lengthOf(a));

/**
 * A vector turned about a unit axis.
 * @param {Vec3} a
 * @param {Vec3} axis
 * @param {number} angle radians
 * @returns {Vec3}
 */
export function turned(a, axis, angle) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return plus(plus(times(a, cos), times(cross(axis, a), sin)), times(axis, dot(axis, a) * (1 - cos)));
}
