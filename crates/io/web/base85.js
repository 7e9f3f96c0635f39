// Bytes as text: four bytes are five digits to base 85, the last group with fewer. The alphabet has no character that HTML or
// JavaScript gives a meaning. The exporter (crates/io/src/page/base85.rs) writes it.

const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_{|";

/**
 * The bytes of a text of digits.
 * @param {string} text
 * @returns {Uint8Array<ArrayBuffer>}
 */
export function bytesOfBase85(text) {
  const value = new Uint8Array(128).fill(255);
  for (let i = 0; i < 85; i++) value[DIGITS.charCodeAt(i)] = i;
  const whole = Math.floor(text.length / 5);
  const left = text.length % 5;
  const out = new Uint8Array(4 * whole + Math.max(0, left - 1));
  let at = 0;
  for (let i = 0; i < text.length; i += 5) {
    let group = 0;
    for (let k = 0; k < 5; k++) {
      // What is missing of the last group counts as the largest digit, so that rounding down gives the bytes back.
      const digit = i + k < text.length ? value[text.charCodeAt(i + k) & 127] : 84;
      if (digit === 255) throw new Error("the scene in this page is damaged: a character is no digit");
      group = group * 85 + digit;
    }
    for (let shift = 24; shift >= 0 && at < out.length; shift -= 8) out[at++] = Math.floor(group / 2 ** shift) % 256;
  }
  return out;
}
