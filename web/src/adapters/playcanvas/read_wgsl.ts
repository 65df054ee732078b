/** The functions of read_glsl.ts and unpack_glsl.ts in WGSL, for WebGPU; words.ts says what the words are. */

import { LN_SCALE_MIN, LN_SCALE_STEPS, OPACITY_STEPS } from "../../pack/words.js";

export const READ_WGSL = `
  var<private> scarFirst_: vec4u;
  var<private> scarLast_: vec4u;

  fn scarHigh(word: u32) -> f32 { return f32(bitcast<i32>(word) >> 16u); }
  fn scarLow(word: u32) -> f32 { return f32(bitcast<i32>(word << 16u) >> 16u); }

  fn getCenter() -> vec3f {
    scarFirst_ = loadScarFirst();
    scarLast_ = loadScarLast();
    return bitcast<vec3f>(scarFirst_.xyz);
  }
  fn getScale() -> vec3f {
    let steps = vec3f(vec3u(scarFirst_.w & 0xffffu, scarFirst_.w >> 16u, scarLast_.x & 0xffffu));
    return exp(steps / ${LN_SCALE_STEPS}.0 + vec3f(${LN_SCALE_MIN}.0));
  }
  fn getRotation() -> vec4f {
    let kept = vec3f(scarHigh(scarLast_.x), scarLow(scarLast_.y), scarHigh(scarLast_.y)) * (${Math.SQRT1_2} / 32767.0);
    let left = sqrt(max(0.0, 1.0 - dot(kept, kept)));
    switch ((scarLast_.w >> 16u) & 3u) {
      case 0u: { return vec4f(left, kept); }
      case 1u: { return vec4f(kept.x, left, kept.yz); }
      case 2u: { return vec4f(kept.xy, left, kept.z); }
      default: { return vec4f(kept, left); }
    }
  }
  fn getColor() -> vec4f {
    return vec4f(unpack2x16float(scarLast_.z), unpack2x16float(scarLast_.w).x, f32(scarLast_.w >> 18u) / ${OPACITY_STEPS}.0);
  }

  #if SH_BANDS > 0
    fn readSHData(sh: ptr<function, array<half3, SH_COEFFS>>, scale: ptr<function, f32>) {
      var texels: array<vec4u, 3>;
      texels[0] = loadScarHarmonics0();
      var last = texels[0];
      #if SH_BANDS > 1
        texels[1] = loadScarHarmonics1();
        last = texels[1];
      #endif
      #if SH_BANDS > 2
        texels[2] = loadScarHarmonics2();
        last = texels[2];
      #endif
      for (var k = 0u; k < u32(SH_COEFFS); k++) {
        var rgb: vec3f;
        for (var c = 0u; c < 3u; c++) {
          let at = 3u * k + c;
          let word = texels[at >> 4u][(at >> 2u) & 3u];
          rgb[c] = f32(bitcast<i32>(word << (24u - 8u * (at & 3u))) >> 24u);
        }
        (*sh)[k] = half3(rgb);
      }
      *scale = unpack2x16float(last.w).y / 127.0;
    }
  #endif
`;
