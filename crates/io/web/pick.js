// What a pixel shows: the splat at which half of the light is absorbed, nearest first. The projection is that of project.frag, in
// JavaScript: a pixel needs few splats, and the list is in order here.

const LEAST_ALPHA = 1 / 255;
const MOST_ALPHA = 0.99;
const REACH = 3.34;

/**
 * A view of the page: rows of the 3x4 view_from_world, focal lengths, principal point and size in pixels.
 * @typedef {{view: number[], focal: [number, number], principal: [number, number], size: [number, number], near: number}} View
 *
 * @param {import("./scene.js").Scene} scene
 * @param {import("./order.js").FlatList} flat
 * @param {Uint32Array} sorted flat indices, nearest first
 * @param {View} view
 * @param {number} px
 * @param {number} py
 * @returns {{row: number, point: number[]} | null} the row and the splat's mean in the world; null where nothing is
 */
export function pick(scene, flat, sorted, view, px, py) {
  let left = 1;
  for (const at of sorted) {
    const splat = splatOf(scene, flat.sources[at], scene.rows[flat.rows[at]]);
    const alpha = alphaAt(scene, splat, view, px, py);
    if (alpha < LEAST_ALPHA) continue;
    left *= 1 - alpha;
    if (left < 0.5) return { row: flat.rows[at], point: splat.mean };
  }
  return null;
}

/**
 * @param {import("./scene.js").Scene} scene
 * @param {number} source
 * @param {import("./scene.js").Row} row
 */
function splatOf(scene, source, row) {
  const { pool, offsets } = scene;
  const record = row.firstOffset < 0 ? -1 : row.firstOffset + source - row.first;
  const of = (/** @type {Float32Array} */ own, /** @type {Float32Array} */ added, /** @type {number} */ width) => {
    const change = (/** @type {number} */ k) => (record < 0 || !added.length ? 0 : added[width * record + k]);
    return Array.from({ length: width }, (_, k) => own[width * source + k] + change(k));
  };
  const [x, y, z] = of(pool.means, offsets.means, 3);
  const m = row.world;
  return {
    mean: [0, 4, 8].map((k) => m[k] * x + m[k + 1] * y + m[k + 2] * z + m[k + 3]),
    world: m,
    logScales: of(pool.logScales, offsets.logScales, 3),
    quat: () => of(pool.quats, offsets.quats, 4),
    opacity: 1 / (1 + Math.exp(-of(pool.logits, offsets.logits, 1)[0])),
  };
}

/**
 * The alpha of a splat at a pixel, not below 0.
 * @param {import("./scene.js").Scene} scene
 * @param {ReturnType<typeof splatOf>} splat
 * @param {View} view
 * @param {number} px
 * @param {number} py
 */
function alphaAt(scene, splat, { view: v, focal, principal, size }, px, py) {
  const [x, y, z] = [0, 4, 8].map((k) => v[k] * splat.mean[0] + v[k + 1] * splat.mean[1] + v[k + 2] * splat.mean[2] + v[k + 3]);
  const dx = px - (focal[0] * x) / z - principal[0];
  const dy = py - (focal[1] * y) / z - principal[1];
  // A bound on the standard deviation in pixels: the largest axis, and slopes up to the clamp.
  const scale = Math.hypot(splat.world[0], splat.world[4], splat.world[8]);
  const limits = [0, 1].map((k) => [-(principal[k] + 0.15 * size[k]) / focal[k], (1.15 * size[k] - principal[k]) / focal[k]]);
  const slope = Math.max(...limits.flat().map(Math.abs));
  const sigma = (scale * Math.exp(Math.max(...splat.logScales)) * Math.max(...focal) * Math.sqrt(1 + 2 * slope * slope)) / z;
  const reach = REACH * Math.sqrt(sigma * sigma + scene.dilation);
  if (!(dx * dx + dy * dy <= reach * reach)) return 0;
  const [bx, by] = projectedAxes(splat, v, focal, limits, x, y, z);
  const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const xx = dot(bx, bx);
  const yy = dot(by, by);
  const xy = dot(bx, by);
  const sharp = Math.max(0, xx * yy - xy * xy);
  const d = scene.dilation;
  const det = sharp + d * (xx + yy) + d * d;
  const opacity = scene.antialias ? splat.opacity * Math.sqrt(Math.max(2.5e-5, sharp / det)) : splat.opacity;
  const q = ((yy + d) * dx * dx - 2 * xy * dx * dy + (xx + d) * dy * dy) / det;
  return Math.min(MOST_ALPHA, opacity * Math.exp(-0.5 * q)) || 0;
}

/**
 * Rows of the Jacobian times the Gaussian's axes in the view.
 * @param {ReturnType<typeof splatOf>} splat
 * @param {number[]} v
 * @param {[number, number]} focal
 * @param {number[][]} limits
 * @param {number} x
 * @param {number} y
 * @param {number} z
 */
function projectedAxes(splat, v, focal, limits, x, y, z) {
  const axes = rotationColumns(splat.quat()).map((column, k) => {
    const m = splat.world;
    const sigma = Math.exp(splat.logScales[k]);
    const world = [0, 4, 8].map((i) => sigma * (m[i] * column[0] + m[i + 1] * column[1] + m[i + 2] * column[2]));
    return [0, 4, 8].map((i) => v[i] * world[0] + v[i + 1] * world[1] + v[i + 2] * world[2]);
  });
  const slopes = [x / z, y / z].map((slope, k) => Math.min(Math.max(slope, limits[k][0]), limits[k][1]));
  return [0, 1].map((k) => axes.map((axis) => (focal[k] / z) * (axis[k] - slopes[k] * axis[2])));
}

/**
 * Columns of the rotation of a quaternion (w, x, y, z) of any length but zero.
 * @param {number[]} quat
 */
function rotationColumns(quat) {
  const length = Math.hypot(...quat);
  const [w, x, y, z] = quat.map((q) => q / length);
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}
