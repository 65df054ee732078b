/**
 * What makes PlayCanvas's picture that of INRIA's renderer, which scenes are trained for.
 *
 * PlayCanvas blurs by 0.3 of its own units of area, of which a pixel has four, where INRIA blurs by 0.3 pixels; it lets a
 * Gaussian fall to nothing at sqrt(8) standard deviations, not at 1/255; it makes those smaller that are larger than the
 * picture, and lets the slope of the projection explode beside it.
 */

import { type AppBase, GSPLATDATA_LARGE, ShaderChunks, SHADERLANGUAGE_GLSL, SHADERLANGUAGE_WGSL } from "playcanvas";

/** Of the half width of a picture: beyond, the slope of the projection is that at the edge. */
const FRUSTUM_MARGIN = 1.3;
/** Larger than any Gaussian in a picture, pixels. */
const LARGEST = 1e6;
/** By how much what is drawn to 1/255 is wider than what is drawn to sqrt(8) standard deviations. */
const WIDER = Math.sqrt(2 * Math.log(255)) / Math.sqrt(8);
/** A Gaussian hides no more than this share of what is behind it. */
const MOST_ALPHA = 0.99;
/** Colours that depend on the direction are made anew where the camera has moved by such an angle. */
const COLOUR_DEGREES = 2;

/** Of chunks of PlayCanvas's shaders by their names: what is replaced in each, and what by. */
type Changes = Record<string, [before: string, after: string][]>;

const GLSL: Changes = {
  gsplatCornerVS: [
    [
      "vec2 J2 = -J1 / vp.z * vp.xy;",
      `vec2 farthest = ${FRUSTUM_MARGIN} / abs(vec2(center.projMat00, center.projMat11));
       vec2 J2 = -J1 * clamp(vp.xy / vp.z, -farthest, farthest);`,
    ],
    ["float detBlur = (cov[0][0] + 0.3) * (cov[1][1] + 0.3)", "float detBlur = (cov[0][0] + 1.2) * (cov[1][1] + 1.2)"],
    ["float diagonal1 = cov[0][0] + 0.3;", "float diagonal1 = cov[0][0] + 1.2;"],
    ["float diagonal2 = cov[1][1] + 0.3;", "float diagonal2 = cov[1][1] + 1.2;"],
    ["min(1024.0, min(viewport_size.x, viewport_size.y))", LARGEST.toFixed(1)],
    ["vec2(max(l1, l2)) * c,", `vec2(${WIDER} * max(l1, l2)) * c,`],
  ],
  gsplatCenterVS: [["camera_params.w != 1.0 && centerView.z > 0.0", "camera_params.w != 1.0 && centerView.z > -camera_params.z"]],
  gsplatCommonVS: [["min(1.0, sqrt(max(0.0, log(alpha / alphaClipValue))) * 0.5)", "sqrt(max(0.0, log(alpha / alphaClipValue))) * 0.5"]],
  gsplatPS: [
    ["return (exp(x * -4.0) - EXP4) * INV_EXP4;", "return exp(x * -4.0);"],
    ["if (A > 1.0) {", `if (A > ${WIDER ** 2}) {`],
    ["normExp(A) * gaussianColor.a", `min(${MOST_ALPHA}, normExp(A) * gaussianColor.a)`],
  ],
};

/**
 * The same where the GPU sorts. What projects is no chunk, so the blur that lacks is added to the Gaussians themselves, as
 * wide as it is where they are; slopes, and Gaussians larger than the picture, stay PlayCanvas's.
 */
const WGSL: Changes = {
  gsplatModifyVS: [
    [
      "rotation: ptr<function, vec4f>, scale: ptr<function, vec3f>) {",
      `rotation: ptr<function, vec4f>, scale: ptr<function, vec3f>) {
         #ifndef GSPLAT_AA
           let pixel = (uniforms.viewMatrix * vec4f(modifiedCenter, 1.0)).z / uniforms.focal;
           *scale = sqrt(*scale * *scale + 0.9 * pixel * pixel);
         #endif`,
    ],
  ],
  gsplatHybridVS: [["min(half(1.0), sqrt(max(half(0.0), log(alpha / alphaClipValue))) * half(0.5))", "sqrt(max(half(0.0), log(alpha / alphaClipValue))) * half(0.5)"]],
  gsplatPS: [
    ["return (exp(x * half(-4.0)) - EXP4) * INV_EXP4;", "return exp(x * half(-4.0));"],
    ["if (A > half(1.0)) {", `if (A > half(${WIDER ** 2})) {`],
    ["normExp(A) * gaussianColor.a", `min(half(${MOST_ALPHA}), normExp(A) * gaussianColor.a)`],
  ],
};

/**
 * Makes an app draw all its splats as INRIA's renderer does, from numbers that are not rounded to 8 bits on the way.
 *
 * Chunks of shaders are replaced by PlayCanvas's own means. Gaussians nearer than the camera's `nearClip` are left out;
 * INRIA's is 0.2. With WebGPU the camera's is not heeded, and pictures are a little less alike.
 * @returns whether that worked: false where the shaders are not those of the release that this was made for; those are
 *   left alone then
 */
export function drawAsTrained(app: AppBase): boolean {
  const { graphicsDevice: device, scene: { gsplat } } = app;
  gsplat.dataFormat = GSPLATDATA_LARGE;
  gsplat.minPixelSize = 0;
  gsplat.minContribution = 0;
  gsplat.colorUpdateAngle = COLOUR_DEGREES;
  const [language, chunks] = device.isWebGPU ? [SHADERLANGUAGE_WGSL, WGSL] : [SHADERLANGUAGE_GLSL, GLSL];
  const theirs = ShaderChunks.get(device, language);
  const changed = new Map<string, string>();
  for (const [name, changes] of Object.entries(chunks)) {
    let code: string = theirs.get(name) ?? "";
    if (!changes.every(([before]) => code.includes(before))) return false;
    for (const [before, after] of changes) code = code.replace(before, after);
    changed.set(name, code);
  }
  const ours = gsplat.material.getShaderChunks(language);
  for (const [name, code] of changed) ours.set(name, code);
  gsplat.material.update();
  return true;
}
