/* Exact numbers of tiles and models: integers as they were decoded, positions and values of SPEC 9.1 and 9.2. */

#include <string.h>

#include "exact.h"

void scar_values(const int32_t *planes, int64_t apart, const int64_t *steps, const double *widths, int64_t n,
                 int64_t columns, float *out);

enum { CODES, CLASSES_OF, INTEGERS, INDICES_OF, SLOTS };
enum { EXACT_POSITIONS, EXACT_VALUES, EXACT_SUMS, EXACT_LATENTS };
enum { CHANNELS, STREAM, COMPONENTS, DIMS, STAGES, BOOK_SIZE, GRID_LEVELS, GRID_BITS, GRID_FEATURES, DECODER_OUTPUTS };

int has_decoder(const Model *m, const TileState *t) { return m->decoder_layer && m->decoder_layer <= t->layer; }

const double *exact_positions(const Model *m, const TileState *t, Pool *pool) {
    const int64_t channel = channel_of(m, POSITION_RESIDUAL), n = t->known;
    const double cell = (double)((int64_t)1 << t->shift);
    double *out = pool_take(pool, 24 * n);
    for (int axis = 0; axis < 3; axis++) {
        const int32_t *residuals = channel < 0 ? NULL : t->values[channel] + axis * n;
        double widths[CLASS_ROOM] = {0};
        for (int64_t k = 0; residuals && k < MOST_CLASSES; k++)
            widths[k] = m->channel[channel].widths[3 * m->rows[t->layer].steps[channel][k] + axis];
        for (int64_t i = 0; i < n; i++) {
            double at = (double)t->corner[axis] + (double)coordinate(t->codes[i] >> axis) * cell + cell / 2;
            if (residuals) at += cell * (residuals[i] * widths[t->classes[i]]);
            out[3 * i + axis] = m->origin[axis] + m->voxel * at;
        }
    }
    return out;
}

const float *exact_values(const Model *m, const TileState *t, int64_t channel, Pool *pool) {
    const ChannelModel *model = m->channel + channel;
    const int64_t components = model->components, n = t->known;
    if (model->stream == OFFSETS) {
        const int64_t numbers = n * m->slots * components;
        float *out = pool_take(pool, 4 * numbers);
        for (int64_t i = 0; i < numbers; i++)
            out[i] = (float)(t->values[channel][i] * model->fields[i % components].first_width);
        return out;
    }
    float *out = pool_take(pool, 4 * fours(n) * components); /* filled up, so that four anchors can be read from any */
    int64_t *steps = pool_take(pool, 8 * n);
    for (int64_t i = 0; i < n; i++) steps[i] = m->rows[t->layer].steps[channel][t->classes[i]];
    scar_values(t->values[channel], n, steps, model->widths, n, components, out);
    return out;
}

/* S of R-9.2-2. */
static const int32_t *exact_sums(const Model *m, const TileState *t, Pool *pool) {
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

EXPORT int32_t scar_tile_count(const TileState *t) { return (int32_t)t->known; }
EXPORT int32_t scar_tile_layer(const TileState *t) { return (int32_t)t->layer; }

/* Integers of a tile: where they lie, NULL for none. */
EXPORT const void *scar_tile_array(const TileState *t, int32_t what, int32_t channel) {
    switch (what) {
        case CODES: return t->codes;
        case CLASSES_OF: return t->classes;
        case INTEGERS: return t->values[channel];
        case INDICES_OF: return t->indices;
        case SLOTS: return t->slots;
        default: return NULL;
    }
}

/* Exact numbers of a tile, valid until the next call: NULL for none. */
EXPORT const void *scar_exact(const TileState *t, int32_t what, int32_t channel) {
    const Model *m = &the_model;
    pool_empty(&layer_scratch, 1);
    switch (what) {
        case EXACT_POSITIONS: return exact_positions(m, t, &layer_scratch);
        case EXACT_VALUES: return exact_values(m, t, channel, &layer_scratch);
        case EXACT_SUMS: return has_decoder(m, t) ? exact_sums(m, t, &layer_scratch) : NULL;
        case EXACT_LATENTS: return has_decoder(m, t) ? exact_latents(m, t, &layer_scratch) : NULL;
        default: return NULL;
    }
}

/* What models say: a number. */
EXPORT int32_t scar_model_number(int32_t what, int32_t which) {
    const Model *m = &the_model;
    const GridLevel *level = m->grid.level + which;
    switch (what) {
        case CHANNELS: return (int32_t)m->channels;
        case STREAM: return (int32_t)m->channel[which].stream;
        case COMPONENTS: return (int32_t)m->channel[which].components;
        case DIMS: return m->decoder.layers ? (int32_t)m->decoder.layer[0].columns : 0;
        case STAGES: return (int32_t)m->most_stages;
        case BOOK_SIZE: return (int32_t)m->books[which].size;
        case GRID_LEVELS: return (int32_t)m->grid.levels;
        case GRID_BITS: return (int32_t)grid_bits(level);
        case GRID_FEATURES: return (int32_t)level->features;
        case DECODER_OUTPUTS: return m->decoder.layers ? (int32_t)m->decoder.layer[m->decoder.layers - 1].rows : 0;
        default: return 0;
    }
}

/* The words of a codebook; the bits of a level of the grid. */
EXPORT const int32_t *scar_model_words(int32_t book) { return the_model.books[book].words; }
EXPORT const uint8_t *scar_model_bits(int32_t level) { return the_model.grid.level[level].bits; }
