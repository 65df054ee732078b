/* From integers to Gaussians as scene files hold them (SPEC 9.1 to 9.4). */

#include "gaussians.h"

/* y - ln(1 - e^y) of y < 0. Where e^y is near 1, its distance from 1 by the series of it: no digit is lost. */
INLINE Float4 logit4(Float4 y) {
    Float4 sum = all4(1.f / 5040);
    sum = sum * y + 1.f / 720;
    sum = sum * y + 1.f / 120;
    sum = sum * y + 1.f / 24;
    sum = sum * y + 1.f / 6;
    sum = sum * y + .5f;
    sum = sum * y + 1;
    return y - log4(choose4(y > -.5f, -y * sum, 1 - exp4(y)));
}

WIDE static void put_logits(const float *values, int64_t n, float *out) {
    for (int64_t i = 0; i < n; i += FLOATS) {
        const Float4 logits = logit4(least4(values ? load4(values + i) : all4(0), all4(MOST_LOG_OPACITY)));
        for (int64_t j = 0; j < FLOATS && i + j < n; j++) out[i + j] = logits[j];
    }
}

void put_scene(const Model *m, const TileState *t, Pool *pool, const SceneRows *out) {
    put_positions(m, t, out->positions);
    put_values(m, t, channel_of(m, SCALE), out->log_scales);
    put_rotations(values_of(m, t, ROTATION, pool), t->known, out->quaternions);
    put_logits(values_of(m, t, OPACITY, pool), t->known, out->logits);
    put_harmonics(m, t, pool, out->harmonics);
}
