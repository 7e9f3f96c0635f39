// Coded tensors of scenes packed as `small`: the twin of crates/io/src/small (field.rs, opponent.rs, entropy.rs),
// decoding only.
//
// Header: rows u64, columns u16, parts u8, flags u8; by part its columns u16, step f32, largest step f32, kind u8 (which class of
// precision its step follows, plus 16 times the quarters of its memory: see field.rs); by column its centre f32. Then integers,
// coded column by column: tokens by an asymmetric numeral system, and lower bits as they are.

const CONTEXTS = 15;
const MIDDLE = 7;
const EXACT = 16;
const PRECISION = 12;
/** Bits that are taken at once: with up to 7 that are left of a byte before, they fit the 32 of a shift. */
const MOST_SHIFT = 16;
const DELTA = 1;
const OPPONENT = 2;
const KINDS = 16;

/**
 * Classes of precision of a group's rows; empty where no part follows them.
 * @typedef {{shape: Uint8Array, colour: Uint8Array}} Classes
 * @typedef {{columns: number, steps: Float64Array, classes: Uint8Array | null, memory: number}} Part
 */

/** @type {Classes} */
export const NO_CLASSES = { shape: new Uint8Array(0), colour: new Uint8Array(0) };

/** A reader of little-endian values. */
class Cursor {
  /** @param {Uint8Array} bytes */
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }
  u8() { return this.view.getUint8(this.at++); }
  u16() { this.at += 2; return this.view.getUint16(this.at - 2, true); }
  u32() { this.at += 4; return this.view.getUint32(this.at - 4, true); }
  u64() { this.at += 8; return Number(this.view.getBigUint64(this.at - 8, true)); }
  f32() { this.at += 4; return this.view.getFloat32(this.at - 4, true); }
}

/**
 * The rows and columns that a coded tensor has.
 * @param {Uint8Array} bytes
 */
export function codedShape(bytes) {
  const cursor = new Cursor(bytes);
  return { rows: cursor.u64(), width: cursor.u16() };
}

/**
 * The values of a coded tensor, row by row.
 * @param {Uint8Array} bytes
 * @param {Classes} classes
 * @returns {Float32Array}
 */
export function decodeField(bytes, classes) {
  const cursor = new Cursor(bytes);
  const rows = cursor.u64();
  const width = cursor.u16();
  const count = cursor.u8();
  const flags = cursor.u8();
  const parts = Array.from({ length: count }, () => readPart(cursor, classes));
  if (flags & DELTA) parts.forEach((part) => { part.memory = 1; });
  const centres = Array.from({ length: width }, () => cursor.f32());
  const decoder = new IntegerDecoder(cursor, count);
  const values = new Float32Array(rows * width);
  const areColours = (flags & OPPONENT) !== 0;
  // Columns come one after another; those of a group go to the rows together, as rows are far apart in memory.
  const inGroup = areColours ? 3 : 1;
  const widest = inGroup * parts.reduce((most, part) => Math.max(most, part.columns), 0);
  const integers = new Float64Array(rows);
  const group = new Float32Array(rows * widest);
  let first = 0;
  let inside = 0;
  parts.forEach((part, model) => {
    for (let k = 0; k < part.columns; k++, inside++) {
      decoder.column(model, part.classes, integers);
      putValues(integers, part, centres[first + inside], group.subarray(inside * rows, (inside + 1) * rows));
    }
    if ((model + 1) % inGroup !== 0) return;
    const columns = group.subarray(0, inside * rows);
    if (areColours) putColours(columns, values, { rows, width, first });
    else putColumns(columns, values, { rows, width, first });
    first += inside;
    inside = 0;
  });
  return values;
}

/**
 * The values of a column.
 * @param {Float64Array} integers
 * @param {Part} part
 * @param {number} centre
 * @param {Float32Array} out
 */
function putValues(integers, part, centre, out) {
  const { steps, classes, memory } = part;
  let prediction = centre;
  for (let row = 0; row < out.length; row++) {
    const value = prediction + integers[row] * steps[classes ? classes[row] : MIDDLE];
    out[row] = value;
    if (memory > 0) prediction = (1 - memory) * prediction + memory * value;
  }
}

/**
 * Where columns lie in rows of values.
 * @typedef {{rows: number, width: number, first: number}} Place
 */

/**
 * Puts consecutive columns into rows.
 * @param {Float32Array} columns
 * @param {Float32Array} values
 * @param {Place} place
 */
function putColumns(columns, values, { rows, width, first }) {
  const count = columns.length / rows;
  for (let row = 0; row < rows; row++) {
    for (let c = 0; c < count; c++) values[row * width + first + c] = columns[c * rows + row];
  }
}

/**
 * Puts columns of a band's brightness and two differences of colour into rows, as red, green and blue by coefficient.
 * @param {Float32Array} columns
 * @param {Float32Array} values
 * @param {Place} place
 */
function putColours(columns, values, { rows, width, first }) {
  const third = columns.length / 3;
  const count = third / rows;
  const rootThird = 1 / Math.sqrt(3);
  for (let row = 0; row < rows; row++) {
    let at = row * width + first;
    for (let i = 0; i < count; i++) {
      const from = i * rows + row;
      const mean = rootThird * columns[from];
      const half = Math.SQRT1_2 * columns[third + from];
      const green = rootThird * Math.SQRT1_2 * columns[2 * third + from];
      values[at++] = mean + half + green;
      values[at++] = mean - 2 * green;
      values[at++] = mean - half + green;
    }
  }
}

/**
 * @param {Cursor} cursor
 * @param {Classes} classes
 * @returns {Part}
 */
function readPart(cursor, classes) {
  const columns = cursor.u16();
  const step = cursor.f32();
  const most = cursor.f32();
  const byte = cursor.u8();
  const kind = byte % KINDS;
  const steps = Float64Array.from({ length: CONTEXTS }, (_, k) => Math.min(step * 2 ** (k - MIDDLE), most));
  const followed = kind === 0 ? null : kind === 1 ? classes.shape : classes.colour;
  return { columns, steps, classes: followed, memory: Math.floor(byte / KINDS) / 4 };
}

/**
 * The classes of precision of a group.
 * @param {Uint8Array} bytes the tensor GROUP.precision.coded
 * @returns {Classes}
 */
export function decodeClasses(bytes) {
  const values = decodeField(bytes, NO_CLASSES);
  const column = (/** @type {number} */ c) => Uint8Array.from({ length: values.length / 2 }, (_, i) => values[2 * i + c]);
  return { shape: column(0), colour: column(1) };
}

/**
 * Quaternions (w, x, y, z) of rows that hold the index of the largest component and the other three, as formats 3 and 4 do.
 * @param {Float32Array} rows
 * @returns {Float32Array}
 */
export function wholeQuats(rows) {
  const out = new Float32Array(rows.length);
  for (let i = 0; i < rows.length; i += 4) {
    const index = rows[i];
    const squares = rows[i + 1] ** 2 + rows[i + 2] ** 2 + rows[i + 3] ** 2;
    // The largest is at least 1/2: what rounding made too large for that is shortened.
    const shorter = squares > 0.75 ? Math.sqrt(0.75 / squares) : 1;
    let next = i + 1;
    for (let k = 0; k < 4; k++) out[i + k] = k === index ? Math.sqrt(1 - Math.min(squares, 0.75)) : rows[next++] * shorter;
  }
  return out;
}

/** The integers of a payload, in order. */
class IntegerDecoder {
  /**
   * @param {Cursor} cursor where the payload begins
   * @param {number} models
   */
  constructor(cursor, models) {
    const words = cursor.u32();
    this.tableOf = Array.from({ length: models * CONTEXTS }, () => cursor.u8());
    this.tables = Array.from({ length: cursor.u8() }, () => readTable(cursor));
    this.words = new Uint16Array(words);
    for (let i = 0; i < words; i++) this.words[i] = cursor.u16();
    this.left = words;
    this.bits = cursor.bytes;
    this.bitsAt = cursor.at;
    this.held = 0;
    this.heldCount = 0;
    this.state = 0;
    // The state is at least 2^16 while words are left.
    while (this.left > 0 && this.state < 65536) this.state = this.state * 65536 + this.words[--this.left];
  }

  /**
   * The integers of the next column.
   * @param {number} model
   * @param {Uint8Array | null} contexts of the rows; null if all have context 0
   * @param {Float64Array} out
   */
  column(model, contexts, out) {
    const tables = this.tableOf.slice(model * CONTEXTS, (model + 1) * CONTEXTS).map((table) => this.tables[table]);
    const { words } = this;
    let { state, left } = this;
    for (let row = 0; row < out.length; row++) {
      const table = tables[contexts ? contexts[row] : 0];
      let token = table.tokens[0];
      if (table.tokens.length > 1) {
        const part = state & 4095;
        const index = table.indexOf[part];
        const first = table.firsts[index];
        state = (state >>> PRECISION) * (table.firsts[index + 1] - first) + part - first;
        if (state < 65536 && left > 0) state = state * 65536 + words[--left];
        token = table.tokens[index];
      }
      out[row] = token < EXACT ? signed(token) : this.large(token - EXACT);
    }
    this.state = state;
    this.left = left;
  }

  /**
   * The integer of a token that says the highest two bits alone.
   * @param {number} token counted from the first of them
   */
  large(token) {
    const low = 3 + (token >> 1);
    const highest = 2 + (token & 1);
    if (low <= MOST_SHIFT) return signed((highest << low) | this.fewBits(low));
    const u = highest * 2 ** low + this.manyBits(low);
    return u % 2 ? -(u + 1) / 2 : u / 2;
  }

  /** @param {number} count at most MOST_SHIFT */
  fewBits(count) {
    while (this.heldCount < count) {
      this.held |= this.bits[this.bitsAt++] << this.heldCount;
      this.heldCount += 8;
    }
    const value = this.held & ((1 << count) - 1);
    this.held >>>= count;
    this.heldCount -= count;
    return value;
  }

  /** @param {number} count at most 45 */
  manyBits(count) {
    // Numbers hold 53 bits, but shifts 32.
    let value = 0;
    let scale = 1;
    for (let left = count; left > 0; left -= MOST_SHIFT) {
      const taken = Math.min(left, MOST_SHIFT);
      value += this.fewBits(taken) * scale;
      scale *= 2 ** taken;
    }
    return value;
  }
}

/**
 * The integer that u stands for: odd ones are negative.
 * @param {number} u below 2^18
 */
function signed(u) {
  return u & 1 ? -((u + 1) >> 1) : u >> 1;
}

/**
 * A table of tokens: `indexOf` by a part of 4096, `firsts` the part where each begins.
 * @param {Cursor} cursor
 */
function readTable(cursor) {
  const count = cursor.u8();
  const tokens = new Uint8Array(count);
  const firsts = new Uint16Array(count + 1);
  const indexOf = new Uint8Array(1 << PRECISION);
  for (let i = 0; i < count; i++) {
    tokens[i] = cursor.u8();
    firsts[i + 1] = firsts[i] + (count === 1 ? 0 : cursor.u16());
    indexOf.fill(i, firsts[i], firsts[i + 1]);
  }
  return { tokens, firsts, indexOf };
}
