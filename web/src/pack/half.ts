/** Binary16 numbers. */

const single = new Float32Array(1);
const bitsOfSingle = new Uint32Array(single.buffer);

/** @returns the 16 bits of the nearest binary16, ties to even; beyond its range an infinity */
export function toHalf(x: number): number {
  single[0] = x;
  const bits = bitsOfSingle[0];
  const sign = (bits >>> 16) & 0x8000;
  const magnitude = bits & 0x7fffffff;
  if (magnitude > 0x7f800000) return sign | 0x7e00;
  if (magnitude >= 0x47800000) return sign | 0x7c00;
  if (magnitude < 0x38800000) return sign | roundEven(Math.abs(single[0]) * 2 ** 24);
  const rebased = magnitude - 0x38000000;
  const kept = rebased >>> 13;
  const rest = rebased & 0x1fff;
  return sign | (kept + (rest > 0x1000 || (rest === 0x1000 && (kept & 1) === 1) ? 1 : 0));
}

function roundEven(x: number): number {
  const below = Math.floor(x);
  const rest = x - below;
  return rest > 0.5 || (rest === 0.5 && below % 2 === 1) ? below + 1 : below;
}
