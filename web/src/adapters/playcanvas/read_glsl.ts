/** What PlayCanvas asks of a format of splats: functions that read one of them, in GLSL. */

import { UNPACK_GLSL } from "../../pack/unpack_glsl.js";

/** Streams of a scene whose harmonics go up to a degree: textures with a texel for each Gaussian. */
export function streamNames(shDegree: number): string[] {
  const harmonics = Array.from({ length: shDegree }, (_, t) => `scarHarmonics${t}`);
  return ["scarFirst", "scarLast", ...harmonics];
}

/** PlayCanvas calls `getCenter` before the others; a rotation is w x y z, colour what is seen without harmonics. */
export const READ_GLSL = `
  ${UNPACK_GLSL}
  uvec4 scarTexels[2];

  vec3 getCenter() {
    scarTexels[0] = loadScarFirst();
    scarTexels[1] = loadScarLast();
    return scarCentre(scarTexels[0]);
  }
  vec3 getScale() { return scarScales(scarTexels[0], scarTexels[1]); }
  vec4 getRotation() { return scarQuaternion(scarTexels[1]).wxyz; }
  vec4 getColor() { return scarColour(scarTexels[1]); }

  #if SH_BANDS > 0
    void readSHData(out vec3 sh[SH_COEFFS], out float scale) {
      uint words[4 * SH_BANDS];
      uvec4 texel = loadScarHarmonics0();
      for (int k = 0; k < 4; k++) words[k] = texel[k];
      #if SH_BANDS > 1
        texel = loadScarHarmonics1();
        for (int k = 0; k < 4; k++) words[4 + k] = texel[k];
      #endif
      #if SH_BANDS > 2
        texel = loadScarHarmonics2();
        for (int k = 0; k < 4; k++) words[8 + k] = texel[k];
      #endif
      for (int k = 0; k < SH_COEFFS; k++) {
        for (int c = 0; c < 3; c++) {
          int at = 3 * k + c;
          sh[k][c] = scarByte(words[at >> 2], at & 3);
        }
      }
      scale = scarStep(texel);
    }
  #endif
`;
