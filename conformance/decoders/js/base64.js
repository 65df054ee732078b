/** Base 64 (RFC 4648 §4) of bytes in parts, piece by piece. */

const ALPHABET = new TextEncoder().encode("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/");
const PAD = 61;
const PIECE = 3 * 65536;

/**
 * @param {ArrayBufferView[]} parts their bytes, one part after the other
 * @returns {Generator<string>}
 */
export function* base64(parts) {
  const piece = new Uint8Array(PIECE);
  let filled = 0;
  for (const part of parts) {
    const bytes = new Uint8Array(part.buffer, part.byteOffset, part.byteLength);
    for (let at = 0; at < bytes.length; ) {
      const n = Math.min(PIECE - filled, bytes.length - at);
      piece.set(bytes.subarray(at, at + n), filled);
      filled += n;
      at += n;
      if (filled === PIECE) {
        yield encode(piece);
        filled = 0;
      }
    }
  }
  if (filled > 0) yield encode(piece.subarray(0, filled));
}

/** @param {Uint8Array} bytes */
function encode(bytes) {
  const out = new Uint8Array(Math.ceil(bytes.length / 3) * 4);
  for (let i = 0, to = 0; i < bytes.length; i += 3, to += 4) {
    const word = (bytes[i] << 16) | ((bytes[i + 1] ?? 0) << 8) | (bytes[i + 2] ?? 0);
    for (let k = 0; k < 4; k++) out[to + k] = ALPHABET[(word >> (18 - 6 * k)) & 63];
  }
  const missing = (3 - (bytes.length % 3)) % 3;
  out.fill(PAD, out.length - missing);
  return new TextDecoder().decode(out);
}
