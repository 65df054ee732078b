/* Exact numbers of tiles and models: integers as they were decoded, positions and values of SPEC 9.1 and 9.2. */

#include <string.h>

#include "exact.h"

int has_decoder(const Model *m, const TileState *t) { return m->decoder_layer && m->decoder_layer <= t->layer; }

WIDE UNFUSED void put_positions(const Model *m, const TileState *t, double *out) {
    const int64_t channel = channel_of(m, POSITION_RESIDUAL), n = t->known;
    const double cell = (double)((int64_t)1 << t->shift);
    for (int axis = 0; axis < 3; axis++) {
        const double corner = (double)t->corner[axis], origin = m->origin[axis], voxel = m->voxel;
        const int32_t *residuals = channel < 0 ? NULL : t->values[channel] + axis * n;
        double widths[CLASS_ROOM] = {0};
        for (int64_t k = 0; residuals && k < MOST_CLASSES; k++)
            widths[k] = m->channel[channel].widths[3 * m->rows[t->layer].steps[channel][k] + axis];
        for (int64_t i = 0; i < n; i++) {
            double at = corner + (double)coordinate(t->codes[i] >> axis) * cell + cell / 2;
            if (residuals) at += cell * (residuals[i] * widths[t->classes[i]]);
            out[3 * i + axis] = origin + voxel * at;
        }
    }
}

const double *exact_positions(const Model *m, const TileState *t, Pool *pool) {
    double *out = pool_take(pool, 24 * t->known);
    put_positions(m, t, out);
    return out;
}

/* Planes of n integers to rows of their values; widths: (classes, components). */
INLINE void scale_rows(const int32_t *planes, int64_t n, int64_t components, const uint8_t *classes,
                       const double *const *widths, float *out) {
    for (int64_t i = 0; i < n; i++)
        for (int64_t c = 0; c < components; c++)
            out[i * components + c] = (float)(planes[c * n + i] * widths[classes[i]][c]);
}

WIDE void put_values(const Model *m, const TileState *t, int64_t channel, float *out) {
    const ChannelModel *model = m->channel + channel;
    const double *widths[CLASS_ROOM];
    for (int64_t k = 0; k < CLASS_ROOM; k++)
        widths[k] = model->widths + model->components * m->rows[t->layer].steps[channel][k];
    switch (model->components) {
        case 1: scale_rows(t->values[channel], t->known, 1, t->classes, widths, out); break;
        case 3: scale_rows(t->values[channel], t->known, 3, t->classes, widths, out); break;
        default: scale_rows(t->values[channel], t->known, model->components, t->classes, widths, out);
    }
}

const float *exact_values(const Model *m, const TileState *t, int64_t channel, Pool *pool) {
    const ChannelModel *model = m->channel + channel;
    const int64_t components = model->components, n = t->known;
    if (model->stream == OFFSETS) {
        const int64_t numbers = n * m->slots * components;
        float *out = pool_take(pool, 4 * numbers);
        for (int64_t i = 0; i < numbers; i++)
            out[i] = (float)(t->values[channel][i] * model->first_width[i % components]);
        return out;
    }
    float *out = pool_take(pool, 4 * fours(n) * components); /* filled up, so that four anchors can be read from any */
    put_values(m, t, channel, out);
    return out;
}

const int32_t *exact_sums(const Model *m, const TileState *t, Pool *pool) {
    const int64_t dims = m->decoder.layer[0].columns;
    int32_t *out = pool_zeros(pool, 4 * t->known * dims);
    for (int64_t i = 0; i < t->known; i++) {
        const int64_t stages = m->rows[t->layer].stages[t->classes[i]];
        for (int64_t stage = 0; stage < stages; stage++) {
            const int32_t *word = m->books[stage > 0].words + t->indices[i * t->stages + stage] * dims;
            for (int64_t d = 0; d < dims; d++) out[i * dims + d] += word[d];
        }
    }
    return out;
}

const float *exact_latents(const Model *m, const TileState *t, Pool *pool) {
    const int64_t dims = m->decoder.layer[0].columns, channel = channel_of(m, LATENT);
    const int32_t *sums = exact_sums(m, t, pool);
    const float *values = channel < 0 ? NULL : exact_values(m, t, channel, pool);
    float *out = pool_take(pool, 4 * t->known * dims);
    for (int64_t i = 0; i < t->known * dims; i++) out[i] = values ? (float)sums[i] + values[i] : (float)sums[i];
    return out;
}
