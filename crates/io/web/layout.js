// How the scene lies in textures and buffers: what worker, page and shaders agree on.

/** Width of all textures, texels; every WebGL2 device has this. */
export const TEXTURE_WIDTH = 2048;
/** Texels of a Gaussian's geometry: mean and logit; quaternion; logarithms of standard deviations. */
export const GEOMETRY_TEXELS = 3;
/** Texels of a row: world (3), colour matrix (3), tint, and indices. */
export const ROW_TEXELS = 8;

/**
 * What can be drawn, in flat order: by splat its Gaussian in the pool and its row.
 * @typedef {{count: number, sources: Uint32Array, rows: Uint32Array}} FlatList
 *
 * @param {import("./scene.js").Row[]} rows
 * @returns {FlatList}
 */
export function flatList(rows) {
  const count = rows.reduce((sum, row) => sum + row.count, 0);
  const out = { count, sources: new Uint32Array(count), rows: new Uint32Array(count) };
  let at = 0;
  rows.forEach((row, r) => {
    for (let local = 0; local < row.count; local++, at++) {
      out.sources[at] = row.first + local;
      out.rows[at] = r;
    }
  });
  return out;
}

/**
 * Constants of the projection: what a scene has not, its shader has no code for.
 * @param {import("./textures.js").SceneTexels} texels
 */
export function constantsOf(texels) {
  return {
    COEFFICIENTS: texels.coefficients,
    SH_TEXELS: texels.sh.texels,
    OFFSET_TEXELS: texels.offsets.texels,
    OFFSET_SHAPE: texels.hasShape ? 1 : 0,
    OFFSET_SH_REST: texels.hasShRest ? 1 : 0,
    FIRST_SH_REST: texels.hasShape ? 4 : 2,
  };
}

/**
 * How a row looks; `tint` is red, green, blue, and how much.
 * @typedef {{shown: boolean, selected: boolean, tint: number[]}} Look
 *
 * @param {Float32Array} rows all rows, which it changes
 * @param {number} row
 * @param {Look} look
 */
export function writeLook(rows, row, look) {
  const at = 4 * ROW_TEXELS * row;
  rows.set(look.tint, at + 24);
  rows.set([Number(look.shown), Number(look.selected)], at + 30);
}
