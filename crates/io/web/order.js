// The order in which splats are drawn: by view depth, ties in flat order (instances in file order, each its template and then
// its own, then the background), as the renderer of instgs-vk has it.

import { flatList } from "./layout.js";

/** @typedef {import("./layout.js").FlatList} FlatList */

const DIGIT = 65536;

/** Sorts splats for a view; buffers are kept between calls. */
export class DepthOrder {
  /** @param {import("./scene.js").Scene} scene */
  constructor(scene) {
    this.scene = scene;
    this.flat = flatList(scene.rows);
    const { count } = this.flat;
    this.depths = new Float32Array(count);
    this.keys = new Uint32Array(this.depths.buffer);
    this.places = new Uint32Array(count);
    this.other = new Uint32Array(count);
    this.counts = new Uint32Array(DIGIT);
  }

  /**
   * Flat indices of splats beyond the near plane, from the nearest to the farthest; valid until the next call.
   * @param {number[]} view rows of the 3x4 transform to the view, OpenCV axes
   * @param {number} near
   * @param {Uint8Array} shown by row
   * @returns {Uint32Array}
   */
  sorted(view, near, shown) {
    const visible = this.measure(view, near, shown);
    // Bits of positive floats are in the order of the floats.
    this.pass(this.places, this.other, visible, 0);
    this.pass(this.other, this.places, visible, 16);
    return this.places.subarray(0, visible);
  }

  /**
   * Fills `depths`, and `places` with what is to be drawn; returns how many there are.
   * @param {number[]} view
   * @param {number} near
   * @param {Uint8Array} shown
   */
  measure(view, near, shown) {
    const { pool, offsets, rows } = this.scene;
    const [x, y, z, w] = view.slice(8, 12);
    let flat = 0;
    let visible = 0;
    rows.forEach((row, r) => {
      const m = row.world;
      // Depth is linear in the template's frame, so that instances need not be expanded.
      const [a, b, c, d] = [0, 1, 2, 3].map((k) => x * m[k] + y * m[4 + k] + z * m[8 + k] + (k === 3 ? w : 0));
      for (let local = 0; shown[r] && local < row.count; local++) {
        const i = 3 * (row.first + local);
        let depth = a * pool.means[i] + b * pool.means[i + 1] + c * pool.means[i + 2] + d;
        if (row.firstOffset >= 0) {
          const o = 3 * (row.firstOffset + local);
          depth += a * offsets.means[o] + b * offsets.means[o + 1] + c * offsets.means[o + 2];
        }
        this.depths[flat + local] = depth;
        if (depth > near) this.places[visible++] = flat + local;
      }
      flat += row.count;
    });
    return visible;
  }

  /**
   * A stable pass of a radix sort over 16 bits of the depths.
   * @param {Uint32Array} from
   * @param {Uint32Array} to
   * @param {number} count
   * @param {number} shift
   */
  pass(from, to, count, shift) {
    const { keys, counts } = this;
    counts.fill(0);
    for (let i = 0; i < count; i++) counts[(keys[from[i]] >>> shift) & (DIGIT - 1)]++;
    let sum = 0;
    for (let digit = 0; digit < DIGIT; digit++) {
      const here = counts[digit];
      counts[digit] = sum;
      sum += here;
    }
    for (let i = 0; i < count; i++) to[counts[(keys[from[i]] >>> shift) & (DIGIT - 1)]++] = from[i];
  }
}

/**
 * The list that the vertex shader takes, from the farthest splat to the nearest: pairs of Gaussian and row.
 * @param {Uint32Array} sorted flat indices, nearest first
 * @param {FlatList} flat
 * @param {Uint32Array} out at least twice as long
 */
export function writeDrawList(sorted, flat, out) {
  const last = sorted.length - 1;
  for (let i = 0; i <= last; i++) {
    const at = sorted[last - i];
    out[2 * i] = flat.sources[at];
    out[2 * i + 1] = flat.rows[at];
  }
}
