/**
 * The words of a decoded tile in the textures that the adapters draw from; the decoder writes them.
 *
 * A Gaussian is eight words of geometry (two RGBA32UI texels), and one texel for each degree of its spherical harmonics:
 *
 *     0..2   centre, three float32
 *     3      ln scale of the first axis (low 16 bits) and the second; steps of 1/2048 from -20
 *     4      ln scale of the third; first kept component of the quaternion
 *     5      second and third kept component
 *     6      red (low 16 bits) and green, float16, of the colour seen when degrees above 0 are left out
 *     7      blue, float16; opacity in steps of 1/16383 (bits 18..31); which component was left out (bits 16..17)
 *
 * Of a unit quaternion (w x y z) the largest component is left out and made positive; the others lie within ±sqrt(1/2)
 * and take signed steps of sqrt(1/2)/32767. Harmonics are signed bytes, coefficient by coefficient, each red, green, blue;
 * the last 16 bits of the last texel are the float16 that a byte of 127 stands for. A slot of zeros draws nothing.
 */

export const GEOMETRY_TEXELS = 2;
export const LN_SCALE_MIN = -20;
export const LN_SCALE_STEPS = 2048;
export const OPACITY_STEPS = 16383;
