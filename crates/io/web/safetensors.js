// Tensors of a safetensors file, as numbers.

/**
 * @typedef {{dtype: string, shape: number[], bytes: Uint8Array}} Tensor
 * @typedef {{metadata: Record<string, string>, tensors: Map<string, Tensor>}} TensorFile
 */

/**
 * @param {Uint8Array} file
 * @returns {TensorFile}
 */
export function parseSafetensors(file) {
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  const length = Number(view.getBigUint64(0, true));
  if (length > file.length - 8) throw new Error("the scene ends within its header");
  const header = JSON.parse(new TextDecoder().decode(file.subarray(8, 8 + length)));
  const data = file.subarray(8 + length);
  const tensors = new Map();
  let metadata = {};
  for (const [name, entry] of Object.entries(header)) {
    if (name === "__metadata__") {
      metadata = entry;
      continue;
    }
    const [begin, end] = entry.data_offsets;
    if (!(begin >= 0 && begin <= end && end <= data.length)) throw new Error(`${name} is beyond the end of the scene`);
    tensors.set(name, { dtype: entry.dtype, shape: entry.shape, bytes: data.subarray(begin, end) });
  }
  return { metadata, tensors };
}

/**
 * The numbers of an F32 or F16 tensor.
 * @param {Tensor} tensor
 * @returns {Float32Array}
 */
export function floatsOf(tensor) {
  const { dtype, bytes } = tensor;
  // A copy is aligned. Machines that run browsers are little-endian, as the file is.
  if (dtype === "F32") return new Float32Array(bytes.slice().buffer);
  if (dtype !== "F16") throw new Error(`a tensor of the type ${dtype} where numbers are needed`);
  const halves = new Uint16Array(bytes.slice().buffer);
  const out = new Float32Array(halves.length);
  for (let i = 0; i < halves.length; i++) out[i] = floatOfHalf(halves[i]);
  return out;
}

/**
 * The numbers of a U32 tensor.
 * @param {Tensor} tensor
 * @returns {Uint32Array}
 */
export function u32sOf(tensor) {
  return new Uint32Array(tensor.bytes.slice().buffer);
}

/**
 * @param {number} half the 16 bits of a half float
 * @returns {number}
 */
export function floatOfHalf(half) {
  const sign = half & 0x8000 ? -1 : 1;
  const exponent = (half >> 10) & 31;
  const fraction = half & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

const oneFloat = new Float32Array(1);
const itsBits = new Uint32Array(oneFloat.buffer);

/**
 * The half float nearest to a number, ties to even; what is too large becomes the largest one.
 * @param {number} value
 * @returns {number} its 16 bits
 */
export function halfOfFloat(value) {
  oneFloat[0] = value;
  const bits = itsBits[0];
  const sign = (bits >>> 16) & 0x8000;
  const size = bits & 0x7fffffff;
  if (size > 0x7f800000) return sign | 0x7e00;
  if (size >= 0x477ff000) return sign | 0x7bff;
  if (size < 0x38800000) return sign | roundHalfEven(Math.abs(value) * 2 ** 24);
  const rounded = size + 0xfff + ((size >>> 13) & 1);
  return sign | ((rounded - 0x38000000) >>> 13);
}

/** @param {number} value 0 or more */
function roundHalfEven(value) {
  const below = Math.floor(value);
  const rest = value - below;
  return below + (rest > 0.5 || (rest === 0.5 && below % 2 === 1) ? 1 : 0);
}
