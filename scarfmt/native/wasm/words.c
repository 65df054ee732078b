/* Words of textures, what src/pack/words.ts defines: the same but for a last step of scales. */

#include "gaussians.h"

#define SH_0 0.28209479177387814
#define LN_SCALE_MIN (-20.0)
#define LN_SCALE_STEPS 2048
#define OPACITY_STEPS 16383
#define SQRT_HALF 0.7071067811865476
#define QUATERNION_STEPS (32767 / SQRT_HALF)
#define LARGEST_HALF 65504
#define GEOMETRY_WORDS 8
#define TEXEL_WORDS 4

/* geometry: (count, 8); harmonics: (count, 4 degree), NULL for degree 0. */
typedef struct {
    int32_t count, degree;
    uint32_t *geometry, *harmonics;
} Words;

/* What is no number counts as low. */
INLINE double limited_to(double x, double low, double high) { return x >= low ? x <= high ? x : high : low; }

/* To the nearest integer, ties up. */
INLINE int32_t nearest(double x) { return (int32_t)__builtin_floor(x + .5); }

/* The nearest binary16, ties to even; beyond its range an infinity. */
static uint32_t half_of_float(float x) {
    union {
        float number;
        uint32_t bits;
    } parts = {x};
    const uint32_t sign = parts.bits >> 16 & 0x8000, size = parts.bits & 0x7fffffff;
    if (size > 0x7f800000) return sign | 0x7e00;
    if (size >= 0x47800000) return sign | 0x7c00;
    if (size < 0x38800000) return sign | (uint32_t)__builtin_rint(__builtin_fabs((double)x) * 0x1p24);
    const uint32_t rebased = size - 0x38000000, kept = rebased >> 13, rest = rebased & 0x1fff;
    return sign | (kept + (rest > 0x1000 || (rest == 0x1000 && kept & 1)));
}

/* ln x of a positive number, to 1e-9. */
static double logarithm(double x) {
    union {
        double number;
        uint64_t bits;
    } parts = {x};
    const int64_t places = (int64_t)((parts.bits + (0x3ff0000000000000 - 0x3fe6a09e667f3bcd)) >> 52) - 1023;
    parts.bits -= (uint64_t)places << 52;
    const double s = (parts.number - 1) / (parts.number + 1), ss = s * s;
    return (double)places * 0.6931471805599453 +
           2 * s * (1 + ss * (1. / 3 + ss * (1. / 5 + ss * (1. / 7 + ss * (1. / 9 + ss / 11)))));
}

static uint32_t scale_steps(float scale) {
    if (!(scale > 0)) return 0;
    if (!__builtin_isfinite(scale)) return 65535;
    return (uint32_t)nearest(limited_to((logarithm(scale) - LN_SCALE_MIN) * LN_SCALE_STEPS, 0, 65535));
}

static uint32_t colour_of(float coefficient) {
    return half_of_float((float)limited_to(.5 + SH_0 * coefficient, -LARGEST_HALF, LARGEST_HALF));
}

/* What of a quaternion is left out, the first of the largest; the others in signed steps. */
static uint32_t smallest_three(const float *q, int32_t *kept) {
    uint32_t largest = 0;
    double squares = 0;
    for (uint32_t k = 0; k < 4; k++) {
        squares += (double)q[k] * q[k];
        if (__builtin_fabsf(q[k]) > __builtin_fabsf(q[largest])) largest = k;
    }
    const double norm = squares > 0 ? __builtin_sqrt(squares) : 1;
    const double steps = (q[largest] < 0 ? -QUATERNION_STEPS : QUATERNION_STEPS) / norm;
    for (uint32_t k = 0; k < 4; k++)
        if (k != largest) *kept++ = nearest(limited_to(q[k] * steps, -32767, 32767));
    return largest;
}

static void pack_geometry(const Gaussians *g, int64_t i, uint32_t *out) {
    const float *colour = g->harmonics + 3 * i * g->coefficients, *s = g->scales + 3 * i;
    int32_t kept[3];
    const uint32_t largest = smallest_three(g->quaternions + 4 * i, kept);
    __builtin_memcpy(out, g->centres + 3 * i, 12);
    out[3] = scale_steps(s[0]) | scale_steps(s[1]) << 16;
    out[4] = scale_steps(s[2]) | (uint32_t)kept[0] << 16;
    out[5] = ((uint32_t)kept[1] & 0xffff) | (uint32_t)kept[2] << 16;
    out[6] = colour_of(colour[0]) | colour_of(colour[1]) << 16;
    out[7] = colour_of(colour[2]) | largest << 16 | (uint32_t)nearest((double)g->opacity[i] * OPACITY_STEPS) << 18;
}

/* Signed bytes of what is above degree 0, in steps of their largest over 127; that ends the last texel as binary16. */
static void pack_harmonics(const float *from, int64_t numbers, uint32_t *out, int64_t words) {
    float peak = 0;
    for (int64_t k = 0; k < numbers; k++) peak = __builtin_fabsf(from[k]) > peak ? __builtin_fabsf(from[k]) : peak;
    const double steps = peak > 0 ? 127 / (double)peak : 0;
    for (int64_t word = 0; word < words; word++) out[word] = 0;
    for (int64_t k = 0; k < numbers; k++) out[k >> 2] |= ((uint32_t)nearest(from[k] * steps) & 255) << (8 * (k & 3));
    out[words - 1] |= half_of_float((float)limited_to(peak, 0, LARGEST_HALF)) << 16;
}

/* A tile in words, valid until the next call; the camera centre matters to the anchor profile alone. */
EXPORT const Words *scar_words(Scar *scar, const TileState *t, double x, double y, double z) {
    const Gaussians *g = scar_gaussians(scar, t, x, y, z, 1);
    Words *out = pool_take(&layer_scratch, sizeof *out);
    out->count = g->count, out->harmonics = NULL;
    for (out->degree = 0; (out->degree + 1) * (out->degree + 1) < g->coefficients;) out->degree++;
    out->geometry = pool_take(&layer_scratch, 4 * GEOMETRY_WORDS * (int64_t)g->count);
    for (int64_t i = 0; i < g->count; i++) pack_geometry(g, i, out->geometry + GEOMETRY_WORDS * i);
    if (out->degree == 0) return out;
    const int64_t words = TEXEL_WORDS * out->degree, numbers = 3 * (int64_t)(g->coefficients - 1);
    out->harmonics = pool_take(&layer_scratch, 4 * words * g->count);
    for (int64_t i = 0; i < g->count; i++)
        pack_harmonics(g->harmonics + 3 * (i * g->coefficients + 1), numbers, out->harmonics + words * i, words);
    return out;
}
