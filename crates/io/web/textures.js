// The scene as texels: what project.frag reads. Templates and offsets are stored once, however many instances
// there are.

import { GEOMETRY_TEXELS, ROW_TEXELS, TEXTURE_WIDTH } from "./layout.js";
import { halfOfFloat } from "./safetensors.js";

/** Indices of rows are floats, which are exact up to here. */
const MOST_EXACT = 2 ** 24;

/**
 * Texels of four 32-bit values; `texels` of them per item.
 * @typedef {{data: Float32Array | Uint32Array, texels: number, height: number}} Texels
 * @typedef {{geometry: Texels, sh: Texels, offsets: Texels, rows: Texels, coefficients: number, hasShape: boolean,
 *   hasShRest: boolean}} SceneTexels
 */

/**
 * @param {import("./scene.js").Scene} scene
 * @returns {SceneTexels}
 */
export function sceneTexels(scene) {
  const { pool, offsets, rows } = scene;
  return {
    geometry: geometryTexels(pool),
    sh: shTexelsOf(pool),
    offsets: offsetTexels(offsets, pool.coefficients),
    rows: rowTexels(rows),
    coefficients: pool.coefficients,
    hasShape: offsets.quats.length > 0 || offsets.logScales.length > 0,
    hasShRest: offsets.shRest.length > 0,
  };
}

/**
 * Room for items of so many texels, in whole lines of a texture.
 * @param {number} items
 * @param {number} texels
 * @returns {Texels & {data: Float32Array}}
 */
function room(items, texels) {
  const height = Math.max(1, Math.ceil((items * texels) / TEXTURE_WIDTH));
  return { data: new Float32Array(4 * TEXTURE_WIDTH * height), texels, height };
}

/** @param {import("./scene.js").Cloud} pool */
function geometryTexels(pool) {
  const out = room(pool.count, GEOMETRY_TEXELS);
  for (let i = 0; i < pool.count; i++) {
    const at = 4 * GEOMETRY_TEXELS * i;
    out.data.set(pool.means.subarray(3 * i, 3 * i + 3), at);
    out.data[at + 3] = pool.logits[i];
    out.data.set(pool.quats.subarray(4 * i, 4 * i + 4), at + 4);
    out.data.set(pool.logScales.subarray(3 * i, 3 * i + 3), at + 8);
  }
  return out;
}

/**
 * SH in half floats: two coefficients in each texel, each red, green, blue and nothing.
 * @param {import("./scene.js").Cloud} pool
 * @returns {Texels}
 */
function shTexelsOf(pool) {
  const { coefficients } = pool;
  const texels = Math.ceil(coefficients / 2);
  const height = Math.max(1, Math.ceil((pool.count * texels) / TEXTURE_WIDTH));
  const halves = new Uint16Array(8 * TEXTURE_WIDTH * height);
  for (let i = 0; i < pool.count; i++) {
    for (let c = 0; c < coefficients; c++) {
      const [from, to] = [3 * (coefficients * i + c), 8 * texels * i + 4 * c];
      for (let k = 0; k < 3; k++) halves[to + k] = halfOfFloat(pool.sh[from + k]);
    }
  }
  return { data: new Uint32Array(halves.buffer), texels, height };
}

/**
 * Mean and logit; SH 0; where there are such offsets quaternion and logarithms of standard deviations; the other SH.
 * @param {import("./scene.js").Offsets} offsets
 * @param {number} coefficients of the pool
 */
function offsetTexels(offsets, coefficients) {
  const hasShape = offsets.quats.length > 0 || offsets.logScales.length > 0;
  const rest = offsets.shRest.length ? offsets.shRest.length / offsets.count : 0;
  const firstRest = hasShape ? 4 : 2;
  const texels = firstRest + (rest ? coefficients - 1 : 0);
  const out = room(offsets.count, texels);
  for (let i = 0; i < offsets.count; i++) {
    const at = 4 * texels * i;
    out.data.set(offsets.means.subarray(3 * i, 3 * i + 3), at);
    out.data[at + 3] = offsets.logits[i];
    out.data.set(offsets.shDc.subarray(3 * i, 3 * i + 3), at + 4);
    out.data.set(offsets.quats.subarray(4 * i, 4 * i + 4), at + 8);
    if (hasShape) out.data.set(offsets.logScales.subarray(3 * i, 3 * i + 3), at + 12);
    for (let k = 0; k < rest; k += 3) {
      out.data.set(offsets.shRest.subarray(rest * i + k, rest * i + k + 3), at + 4 * (firstRest + k / 3));
    }
  }
  return out;
}

/**
 * World and colour matrices; tint (red, green, blue, how much); first Gaussian, first offset, whether it is shown, and whether
 * it is selected.
 * @param {import("./scene.js").Row[]} rows
 */
export function rowTexels(rows) {
  if (rows.some((row) => Math.max(row.first, row.firstOffset) > MOST_EXACT)) {
    throw new Error("the scene has more Gaussians than this page can count");
  }
  const out = room(rows.length, ROW_TEXELS);
  rows.forEach((row, r) => {
    const at = 4 * ROW_TEXELS * r;
    out.data.set(row.world, at);
    out.data.set(row.colour, at + 12);
    out.data.set([row.first, row.firstOffset, 1, 0], at + 28);
  });
  return out;
}
