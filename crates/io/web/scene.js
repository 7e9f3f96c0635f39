// A scene from the bytes of an .instgs file: one pool of Gaussians (templates, instances' own, background), rows that place
// ranges of it, and offsets. Instances are not expanded. The conventions are those of docs/design.md.

import { NO_CLASSES, codedShape, decodeClasses, decodeField, wholeQuats } from "./coded.js";
import { floatsOf, parseSafetensors, u32sOf } from "./safetensors.js";
import { offsetShapesFrom, shapesFrom } from "./shapes.js";

const NO_OFFSET = 0xffffffff;
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

/**
 * Gaussians, structure of arrays: means [N, 3], quaternions [N, 4] (w, x, y, z), logarithms of standard deviations [N, 3], logits
 * of opacities [N], SH [N, coefficients, 3].
 * @typedef {{count: number, coefficients: number, means: Float32Array, quats: Float32Array, logScales: Float32Array,
 *   logits: Float32Array, sh: Float32Array}} Cloud
 *
 * Offset records; the last three are empty in nearly all scenes.
 * @typedef {{count: number, means: Float32Array, shDc: Float32Array, logits: Float32Array, logScales: Float32Array,
 *   quats: Float32Array, shRest: Float32Array}} Offsets
 *
 * A range of the pool, placed in the world: an instance's template, its own Gaussians, or the background (owner -1). `world` and
 * `colour` are rows of 3x4 matrices; `firstOffset` is -1 without offsets.
 * @typedef {{owner: number, first: number, count: number, firstOffset: number, world: number[], colour: number[]}} Row
 *
 * @typedef {{template: number, name: string, id: number}} InstanceName
 * @typedef {{pool: Cloud, rows: Row[], offsets: Offsets, names: InstanceName[], templateCounts: number[],
 *   backgroundCount: number, near: number, dilation: number, antialias: boolean}} Scene
 */

/** The tensors of a file by name, whatever their form. */
class Reader {
  /** @param {import("./safetensors.js").TensorFile} file */
  constructor(file) {
    this.tensors = file.tensors;
    /** @type {Map<string, import("./coded.js").Classes>} */
    this.classes = new Map();
  }

  /** @param {string} name */
  has(name) { return this.tensors.has(name) || this.tensors.has(`${name}.coded`); }

  /**
   * The numbers of a tensor; empty if it is absent.
   * @param {string} name
   */
  floats(name) {
    const plain = this.tensors.get(name);
    if (plain) return floatsOf(plain);
    const coded = this.tensors.get(`${name}.coded`);
    if (!coded) return new Float32Array(0);
    const group = name.split(".")[0];
    if (!this.classes.has(group)) {
      const precision = this.tensors.get(`${group}.precision.coded`);
      this.classes.set(group, precision ? decodeClasses(precision.bytes) : NO_CLASSES);
    }
    const values = decodeField(coded.bytes, this.classes.get(group) ?? NO_CLASSES);
    return name.endsWith(".quats") && group !== "offset" ? wholeQuats(values) : values;
  }

  /** @param {string} name */
  u32s(name) {
    const tensor = this.tensors.get(name);
    return tensor ? u32sOf(tensor) : new Uint32Array(0);
  }

  /**
   * Number of SH coefficients of a cloud.
   * @param {string} name
   */
  coefficients(name) {
    const plain = this.tensors.get(name);
    if (plain) return plain.shape[1];
    const coded = this.tensors.get(`${name}.coded`);
    return coded ? codedShape(coded.bytes).width / 3 : 1;
  }

  /**
   * @param {string} group
   * @returns {Cloud}
   */
  cloud(group) {
    const means = this.floats(`${group}.means`);
    const { quats, logScales } = this.has(`${group}.log_covariances`)
      ? shapesFrom(this.floats(`${group}.log_covariances`))
      : { quats: this.floats(`${group}.quats`), logScales: this.floats(`${group}.log_scales`) };
    return {
      count: means.length / 3,
      coefficients: this.coefficients(`${group}.sh`),
      means,
      quats,
      logScales,
      logits: this.floats(`${group}.opacity_logits`),
      sh: this.floats(`${group}.sh`),
    };
  }
}

/**
 * @param {Uint8Array} bytes
 * @returns {Scene}
 */
export function parseScene(bytes) {
  const file = parseSafetensors(bytes);
  const reader = new Reader(file);
  const [templates, own, background] = ["template", "own", "background"].map((group) => reader.cloud(group));
  const pool = joined([templates, own, background]);
  const ranges = reader.u32s("template.ranges");
  const templateOf = reader.u32s("instance.template");
  const firstOffset = reader.u32s("instance.first_offset");
  const worlds = reader.floats("instance.world_from_template");
  const colours = reader.floats("instance.color_from_template");
  const ownRanges = reader.u32s("instance.own");
  const rowOf = (/** @type {Float32Array} */ values, /** @type {number} */ k) => Array.from(values.subarray(12 * k, 12 * k + 12));
  /** @type {Row[]} */
  const rows = [];
  templateOf.forEach((template, k) => {
    const world = rowOf(worlds, k);
    rows.push({
      owner: k,
      first: ranges[2 * template],
      count: ranges[2 * template + 1],
      firstOffset: firstOffset[k] === NO_OFFSET ? -1 : firstOffset[k],
      world,
      colour: colours.length ? rowOf(colours, k) : IDENTITY,
    });
    if (ownRanges.length && ownRanges[2 * k + 1] > 0) {
      const first = templates.count + ownRanges[2 * k];
      rows.push({ owner: k, first, count: ownRanges[2 * k + 1], firstOffset: -1, world, colour: IDENTITY });
    }
  });
  const first = templates.count + own.count;
  rows.push({ owner: -1, first, count: background.count, firstOffset: -1, world: IDENTITY, colour: IDENTITY });
  const { metadata } = file;
  return {
    pool,
    rows,
    offsets: readOffsets(reader, rows, templates),
    names: namesOf(templateOf, JSON.parse(metadata.groups ?? "[]")),
    templateCounts: Array.from({ length: ranges.length / 2 }, (_, t) => ranges[2 * t + 1]),
    backgroundCount: background.count,
    near: metadata.near === undefined ? 0.2 : Number(metadata.near),
    dilation: metadata.dilation_px2 === undefined ? 0.3 : Number(metadata.dilation_px2),
    antialias: metadata.antialias === "true",
  };
}

/**
 * Clouds one after another, with the SH of the highest degree among them.
 * @param {Cloud[]} clouds
 * @returns {Cloud}
 */
function joined(clouds) {
  const count = clouds.reduce((sum, cloud) => sum + cloud.count, 0);
  const coefficients = clouds.reduce((most, cloud) => Math.max(most, cloud.count ? cloud.coefficients : 1), 1);
  /** @type {Cloud} */
  const out = {
    count,
    coefficients,
    means: new Float32Array(3 * count),
    quats: new Float32Array(4 * count),
    logScales: new Float32Array(3 * count),
    logits: new Float32Array(count),
    sh: new Float32Array(3 * coefficients * count),
  };
  let first = 0;
  for (const cloud of clouds) {
    out.means.set(cloud.means, 3 * first);
    out.quats.set(cloud.quats, 4 * first);
    out.logScales.set(cloud.logScales, 3 * first);
    out.logits.set(cloud.logits, first);
    const width = 3 * cloud.coefficients;
    for (let i = 0; i < cloud.count; i++) {
      out.sh.set(cloud.sh.subarray(i * width, (i + 1) * width), 3 * coefficients * (first + i));
    }
    first += cloud.count;
  }
  return out;
}

/**
 * @param {Reader} reader
 * @param {Row[]} rows
 * @param {Cloud} templates
 * @returns {Offsets}
 */
function readOffsets(reader, rows, templates) {
  const channels = [["means", 3], ["sh_dc", 3], ["opacity_logits", 1]];
  const [means, shDc, logits] = (() => {
    if (!reader.tensors.has("offset.range")) return channels.map(([name]) => reader.floats(`offset.${name}`));
    return readBytes(reader, rows, channels.map(([name, width]) => [`offset.${name}`, Number(width)]));
  })();
  const { quats, logScales } = reader.has("offset.log_covariances")
    ? offsetShapesFrom(reader.floats("offset.log_covariances"), templates, rows)
    : { quats: reader.floats("offset.quats"), logScales: reader.floats("offset.log_scales") };
  const shRest = reader.floats("offset.sh_rest");
  return { count: logits.length, means, shDc, logits, logScales, quats, shRest };
}

/**
 * Offsets in 8 bits (pack q8): records are cut into segments where the run of an instance begins or ends, and each segment has a
 * lowest and a highest value per channel.
 * @param {Reader} reader
 * @param {Row[]} rows
 * @param {[string, number][]} channels names and widths
 */
function readBytes(reader, rows, channels) {
  const count = reader.tensors.get("offset.means")?.shape[0] ?? 0;
  const cuts = new Set([0, count]);
  for (const { firstOffset, count: length } of rows) {
    if (firstOffset >= 0) [firstOffset, firstOffset + length].filter((cut) => cut <= count).forEach((cut) => cuts.add(cut));
  }
  const ordered = [...cuts].sort((a, b) => a - b);
  const ranges = reader.floats("offset.range");
  let channel = 0;
  return channels.map(([name, width]) => {
    const tensor = reader.tensors.get(name);
    const first = channel;
    channel += width;
    if (!tensor || tensor.dtype !== "U8") return reader.floats(name);
    const out = new Float32Array(count * width);
    for (let s = 0; s + 1 < ordered.length; s++) {
      for (let at = ordered[s] * width; at < ordered[s + 1] * width; at++) {
        const range = 2 * (7 * s + first + (at % width));
        const q = tensor.bytes[at];
        out[at] = (ranges[range] * (255 - q) + ranges[range + 1] * q) / 255;
      }
    }
    return out;
  });
}

/**
 * What to call each instance: the name of its group, and its mask id or else its number among those of its template. The j-th
 * instance of a template has the j-th id of the template's groups, one group after another; those beyond belong to the last.
 * @param {Uint32Array} templateOf
 * @param {{template_id: number, name?: string, instance_ids: number[]}[]} groups
 * @returns {InstanceName[]}
 */
function namesOf(templateOf, groups) {
  /** @type {Map<number, {ids: {name?: string, id: number}[], last?: string}>} */
  const labelsOf = new Map();
  for (const { template_id: template, name, instance_ids: ids } of groups) {
    const labels = labelsOf.get(template) ?? { ids: [] };
    for (const id of ids) labels.ids.push({ name, id });
    labelsOf.set(template, { ids: labels.ids, last: name });
  }
  /** @type {Map<number, number>} */
  const seen = new Map();
  return Array.from(templateOf, (template) => {
    const labels = labelsOf.get(template);
    const place = seen.get(template) ?? 0;
    seen.set(template, place + 1);
    const { name, id } = labels?.ids[place] ?? { name: labels?.last, id: place };
    return { template, name: name ?? `template ${template}`, id };
  });
}
