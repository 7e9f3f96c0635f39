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
  const centres = Array.from({ length: width }, () => cursor.f32());
  const decoder = new IntegerDecoder(cursor, count);
  const values = new Float32Array(rows * width);
  let column = 0;
  parts.forEach((part, model) => {
    const memory = flags & DELTA ? 1 : part.memory;
    for (let end = column + part.columns; column < end; column++) {
      let prediction = centres[column];
      for (let row = 0; row < rows; row++) {
        const context = part.classes ? part.classes[row] : 0;
        const integer = decoder.next(model * CONTEXTS + context);
        const value = prediction + integer * part.steps[part.classes ? context : MIDDLE];
        values[row * width + column] = value;
        if (memory > 0) prediction = (1 - memory) * prediction + memory * value;
      }
    }
  });
  if (flags & OPPONENT) rgbFromOpponent(values, width, parts);
  return values;
}

/**
 * Turns rows of brightness and two differences of colour, band by band, to rows of red, green and blue by coefficient.
 * @param {Float32Array} values
 * @param {number} width
 * @param {Part[]} parts three for each band
 */
function rgbFromOpponent(values, width, parts) {
  const coded = new Float32Array(width);
  const rootThird = 1 / Math.sqrt(3);
  for (let row = 0; row < values.length; row += width) {
    coded.set(values.subarray(row, row + width));
    let first = 0;
    for (let part = 0; part < parts.length; part += 3) {
      const count = parts[part].columns;
      for (let i = 0; i < count; i++) {
        const mean = rootThird * coded[first + i];
        const half = Math.SQRT1_2 * coded[first + count + i];
        const green = rootThird * Math.SQRT1_2 * coded[first + 2 * count + i];
        const at = row + first + 3 * i;
        values[at] = mean + half + green;
        values[at + 1] = mean - 2 * green;
        values[at + 2] = mean - half + green;
      }
      first += 3 * count;
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
    this.words = Uint16Array.from({ length: words }, () => cursor.u16());
    this.left = words;
    this.bits = cursor.bytes;
    this.bitsAt = cursor.at;
    this.held = 0;
    this.heldCount = 0;
    this.state = 0;
    // The state is at least 2^16 while words are left.
    while (this.left > 0 && this.state < 65536) this.state = this.state * 65536 + this.words[--this.left];
  }

  /** @param {number} place model and context of the value */
  next(place) {
    const token = this.token(this.tables[this.tableOf[place]]);
    if (token < EXACT) return token % 2 ? -(token + 1) / 2 : token / 2;
    const low = 3 + ((token - EXACT) >> 1);
    const u = (2 + ((token - EXACT) & 1)) * 2 ** low + this.lowBits(low);
    return u % 2 ? -(u + 1) / 2 : u / 2;
  }

  /** @param {ReturnType<typeof readTable>} table */
  token(table) {
    if (table.tokens.length < 2) return table.tokens[0];
    const part = this.state & 4095;
    const index = table.indexOf[part];
    const first = table.firsts[index];
    let state = Math.floor(this.state / 4096) * (table.firsts[index + 1] - first) + part - first;
    if (state < 65536 && this.left > 0) state = state * 65536 + this.words[--this.left];
    this.state = state;
    return table.tokens[index];
  }

  /** @param {number} count at most 45 */
  lowBits(count) {
    // Numbers hold 53 bits: bits are taken one byte at a time.
    let value = 0;
    let scale = 1;
    while (count > 0) {
      if (this.heldCount === 0) {
        this.held = this.bits[this.bitsAt++];
        this.heldCount = 8;
      }
      const taken = Math.min(count, this.heldCount);
      value += (this.held & ((1 << taken) - 1)) * scale;
      scale *= 2 ** taken;
      this.held >>= taken;
      this.heldCount -= taken;
      count -= taken;
    }
    return value;
  }
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
