/* Words of Spark's packed splats, what src/pack/spark.ts defines: the same but for a last step of angles and scales. */

#include "gaussians.h"

#define SH_0 0.28209479177387814
#define LEAST_LOG (-12.0) /* logarithms of the scales of bytes 1 and 255 */
#define MOST_LOG 9.0
#define FLAT 9.357622968840175e-14 /* e^-30: below it, byte 0 */
#define NO_AXIS 1e-6
#define PI 3.141592653589793
#define DEGREES 3

/* By degree: words a splat, bits a number, first coefficient, how many numbers. */
static const struct {
    int64_t words, bits, first, numbers;
} BANDS[DEGREES] = {{2, 7, 1, 9}, {4, 8, 4, 15}, {4, 6, 9, 21}};

/* words: (count, 4); bands: by degree, NULL where the scene has none. */
typedef struct {
    int32_t count;
    uint32_t *words, *bands[DEGREES];
} Splats;

/* What is no number counts as low. */
INLINE double limited_to(double x, double low, double high) { return x >= low ? x <= high ? x : high : low; }

/* To the nearest integer, ties up. */
INLINE int32_t nearest(double x) { return (int32_t)__builtin_floor(x + .5); }

INLINE uint32_t byte_of(double x) { return (uint32_t)nearest(255 * limited_to(x, 0, 1)); }

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

/* The angle of (x, y), neither below 0, to 1e-8. */
static double angle_of(double y, double x) {
    const double t = y < x ? y / x : x / y, z = t > 0.4142135623730951 ? (t - 1) / (t + 1) : t, zz = z * z;
    const double series =
        z * (1 + zz * (-1. / 3 + zz * (1. / 5 + zz * (-1. / 7 + zz * (1. / 9 + zz * (-1. / 11 + zz * (1. / 13)))))));
    const double angle = t > 0.4142135623730951 ? PI / 4 + series : series;
    return y < x ? angle : PI / 2 - angle;
}

static uint32_t scale_byte(float scale) {
    if (!(scale >= FLAT)) return 0;
    if (!__builtin_isfinite(scale)) return 255;
    const double step = (logarithm(scale) - LEAST_LOG) * 254 / (MOST_LOG - LEAST_LOG);
    return (uint32_t)nearest(limited_to(step, 0, 254)) + 1;
}

INLINE double signed_like(double x, double sign) { return sign >= 0 ? x : -x; }

/* Two octahedral bytes of the axis, and above them the angle in 255 steps of half a turn. */
static uint32_t rotation_bytes(const float *q) {
    const double sign = q[0] < 0 ? -1 : 1, w = limited_to(sign * q[0], 0, 1);
    double x = sign * q[1], y = sign * q[2], z = sign * q[3];
    const double length = __builtin_sqrt(x * x + y * y + z * z);
    if (length < NO_AXIS) x = 1, y = z = 0;
    const double sum = __builtin_fabs(x) + __builtin_fabs(y) + __builtin_fabs(z);
    double u = x / sum, v = y / sum;
    if (z < 0) {
        const double before = u;
        u = signed_like(1 - __builtin_fabs(v), u), v = signed_like(1 - __builtin_fabs(before), v);
    }
    return byte_of(2 * angle_of(length, w) / PI) << 16 | byte_of(v / 2 + .5) << 8 | byte_of(u / 2 + .5);
}

static void pack_splat(const Gaussians *g, int64_t i, uint32_t *out) {
    const float *colour = g->harmonics + 3 * i * g->coefficients, *centre = g->centres + 3 * i, *s = g->scales + 3 * i;
    const uint32_t turn = rotation_bytes(g->quaternions + 4 * i);
    out[0] = byte_of(g->opacity[i]) << 24;
    for (int c = 0; c < 3; c++) out[0] |= byte_of(.5 + SH_0 * colour[c]) << 8 * c;
    out[1] = half_of_float(centre[0]) | half_of_float(centre[1]) << 16;
    out[2] = half_of_float(centre[2]) | (turn & 0xffff) << 16;
    out[3] = scale_byte(s[0]) | scale_byte(s[1]) << 8 | scale_byte(s[2]) << 16 | turn >> 16 << 24;
}

static void pack_band(const Gaussians *g, int degree, uint32_t *out) {
    const int64_t bits = BANDS[degree].bits, words = BANDS[degree].words;
    const uint32_t mask = (1u << bits) - 1;
    const double most = mask >> 1;
    const float *from = g->harmonics + 3 * BANDS[degree].first;
    for (int64_t i = 0; i < g->count; i++, from += 3 * g->coefficients, out += words) {
        uint64_t held = 0;
        int64_t filled = 0, word = 0;
        for (int64_t j = 0; j < BANDS[degree].numbers; j++) {
            held |= (uint64_t)((uint32_t)nearest(limited_to(from[j], -1, 1) * most) & mask) << filled;
            filled += bits;
            if (filled < 32) continue;
            out[word++] = (uint32_t)held, held >>= 32, filled -= 32;
        }
        if (word < words) out[word] = (uint32_t)held;
    }
}

const Gaussians *scar_gaussians(const TileState *t, double x, double y, double z, int32_t drawn);

/* A tile in Spark's words, valid until the next call; the camera centre matters to the anchor profile alone. */
EXPORT const Splats *scar_spark(const TileState *t, double x, double y, double z) {
    static Splats out;
    const Gaussians *g = scar_gaussians(t, x, y, z, 1);
    out.count = g->count, out.words = pool_take(&layer_scratch, 16 * (int64_t)g->count);
    for (int64_t i = 0; i < g->count; i++) pack_splat(g, i, out.words + 4 * i);
    for (int degree = 0; degree < DEGREES; degree++) {
        out.bands[degree] = NULL;
        if ((degree + 2) * (degree + 2) > g->coefficients) continue;
        out.bands[degree] = pool_take(&layer_scratch, 4 * BANDS[degree].words * g->count);
        pack_band(g, degree, out.bands[degree]);
    }
    return &out;
}
