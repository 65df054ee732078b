/** How a shader reads the words of words.ts, in GLSL ES 3.00; for the adapters, whose viewers want them in forms of their own. */

import { LN_SCALE_MIN, LN_SCALE_STEPS, OPACITY_STEPS } from "./words.js";

/** Functions of the two texels of a Gaussian, and of those of its harmonics. */
export const UNPACK_GLSL = `
  int scarHigh(uint word) { return int(word) >> 16; }
  int scarLow(uint word) { return int(word << 16) >> 16; }

  vec3 scarCentre(uvec4 first) { return uintBitsToFloat(first.xyz); }

  vec3 scarScales(uvec4 first, uvec4 last) {
    vec3 steps = vec3(uvec3(first.w & 0xffffu, first.w >> 16u, last.x & 0xffffu));
    return exp(steps / ${LN_SCALE_STEPS}.0 + float(${LN_SCALE_MIN}));
  }

  // Stored as w x y z without the largest, given as x y z w.
  vec4 scarQuaternion(uvec4 last) {
    vec3 kept = vec3(ivec3(scarHigh(last.x), scarLow(last.y), scarHigh(last.y))) * (${Math.SQRT1_2} / 32767.0);
    float left = sqrt(max(0.0, 1.0 - dot(kept, kept)));
    uint largest = (last.w >> 16u) & 3u;
    if (largest == 0u) return vec4(kept, left);
    if (largest == 1u) return vec4(left, kept.yz, kept.x);
    if (largest == 2u) return vec4(kept.y, left, kept.z, kept.x);
    return vec4(kept.yz, left, kept.x);
  }

  float scarOpacity(uvec4 last) { return float(last.w >> 18u) / ${OPACITY_STEPS}.0; }
  vec4 scarColour(uvec4 last) { return vec4(unpackHalf2x16(last.z), unpackHalf2x16(last.w).x, scarOpacity(last)); }

  // Byte number at of a word, signed.
  float scarByte(uint word, int at) { return float(int(word << (24 - 8 * at)) >> 24); }
  // What a step of a byte stands for, by the last texel of the harmonics.
  float scarStep(uvec4 texel) { return unpackHalf2x16(texel.w).y / 127.0; }
`;
