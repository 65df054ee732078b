/* What the index network reads (SPEC 10.5, 10.6): scarfmt/codecs/neural_indices.py and scarfmt/neural/grid.py. */

#include "cells.h"

#define CLASS_VALUE 64.0f
#define FEATURE_MAX 127
#define MOST_FEATURES 8

static const int64_t PRIMES[3] = {1, 2654435761, 805459861};

/* Adds up the weights of the vertices whose bit is 1, feature by feature. */
static void vertex_sums(const Grid *grid, const GridLevel *level, const int64_t *inside, int64_t *ones) {
    int64_t address[8] = {0}, weight[8] = {1}, stride = 1;
    const int64_t spare = grid->extent_bits - 8, mask = ((int64_t)1 << level->table_log2) - 1;
    for (int64_t d = 0; d < level->dims; d++) {
        const int64_t scaled = inside[level->axes[d]] * level->resolution;
        const int64_t cell = scaled >> grid->extent_bits;
        const int64_t fraction = (spare >= 0 ? scaled >> spare : scaled << -spare) & 255;
        const int64_t factor = level->dense ? stride : PRIMES[d];
        for (int64_t v = (int64_t)1 << d; v--;) {
            const int64_t low = cell * factor, high = low + factor, before = address[v];
            address[v] = level->dense ? before + low : before ^ (low & mask);
            address[v + ((int64_t)1 << d)] = level->dense ? before + high : before ^ (high & mask);
            weight[v + ((int64_t)1 << d)] = weight[v] * fraction;
            weight[v] *= 256 - fraction;
        }
        stride *= level->resolution + 1;
    }
    for (int64_t v = 0; v < (int64_t)1 << level->dims; v++) {
        const uint8_t *bits = level->bits + address[v] * level->features;
        for (int64_t f = 0; f < level->features; f++) ones[f] += weight[v] * bits[f];
    }
}

/* (n, width) features of anchors at (n, 3) lattice `positions`. */
void scar_grid(const Grid *grid, const int64_t *positions, int64_t n, int16_t *out) {
    const int64_t last = ((int64_t)1 << grid->extent_bits) - 1;
    for (int64_t i = 0; i < n; i++, positions += 3) {
        int64_t inside[3];
        for (int d = 0; d < 3; d++) {
            const int64_t offset = positions[d] - grid->origin[d];
            inside[d] = offset < 0 ? 0 : offset > last ? last : offset;
        }
        for (int64_t l = 0; l < grid->levels; l++) {
            const GridLevel *level = grid->level + l;
            const int64_t bits = 8 * level->dims, shift = bits - 7;
            int64_t ones[MOST_FEATURES] = {0};
            vertex_sums(grid, level, inside, ones);
            for (int64_t f = 0; f < level->features; f++) {
                const int64_t value = (2 * ones[f] - ((int64_t)1 << bits) + ((int64_t)1 << (shift - 1))) >> shift;
                *out++ = (int16_t)(value < -FEATURE_MAX ? -FEATURE_MAX : value > FEATURE_MAX ? FEATURE_MAX : value);
            }
        }
    }
}

INLINE float within(double value, double amax) {
    return (float)(value < -amax ? -amax : value > amax ? amax : value);
}

/* (m, width) inputs of m anchors; `rows` are their names in `cells`. */
WIDE void scar_embedding_inputs(const Embedding *e, const Cells *cells, const int64_t *anchors,
                                       const int64_t *rows, int64_t m, float *out) {
    const int64_t columns = e->attributes + e->latents;
    const double amax = (double)e->amax, scale = 1.0 / (double)((int64_t)1 << e->latent_shift);
    const double half = e->latent_shift ? 0.5 : 0;
    double mean[MOST_CONTEXT_COLUMNS];
    for (int64_t i = 0; i < m; i++) {
        const int64_t anchor = anchors[i];
        for (int64_t c = 0; c < e->classes; c++)
            *out++ = c == e->anchor_class[anchor] ? within(CLASS_VALUE, amax) : 0;
        for (int64_t c = 0; e->own && c < e->attributes; c++)
            *out++ = within((double)(e->settled[anchor * e->attributes + c] >> 6), amax);
        for (int64_t c = 0; c < columns; c++) mean[c] = 0;
        for (int64_t d = 0; d < cells->depths; d++) {
            const double count = cell_means(cells, d, rows[i], mean);
            for (int64_t c = 0; c < e->attributes; c++) *out++ = within(floor_of(mean[c] * (1.0 / 64)), amax);
            for (int64_t c = e->attributes; c < columns; c++) *out++ = within(floor_of(mean[c] * scale + half), amax);
            *out++ = within(count_feature(count), amax);
        }
        for (int64_t c = 0; c < e->grid; c++) *out++ = within(e->features[anchor * e->grid + c], amax);
    }
}
