/* The memory of tiles. */

#include <string.h>

#include "tile.h"

static void *carved(uint8_t *base, int64_t *used, int64_t bytes) {
    void *at = base ? base + *used : NULL;
    *used += (bytes + 15) / 16 * 16;
    return at;
}

/* Numbers of an anchor in channel c. */
static int64_t numbers_of(const Model *m, int64_t c) {
    return m->channel[c].components * (m->channel[c].stream == OFFSETS ? m->slots : 1);
}

/* Lays out the arrays of a tile from `base` on, behind the struct; returns the bytes taken. */
static int64_t lay_out(const Model *m, TileState *t, uint8_t *base) {
    const int64_t n = t->known;
    int64_t used = 0;
    carved(base, &used, sizeof *t);
    t->codes = carved(base, &used, 8 * n), t->classes = carved(base, &used, n);
    for (int64_t c = 0; c < m->channels; c++) t->values[c] = carved(base, &used, 4 * n * numbers_of(m, c));
    t->indices = carved(base, &used, 2 * n * t->stages);
    t->slots = m->profile == ANCHOR ? carved(base, &used, n * m->slots) : NULL;
    return used;
}

/* Copies `rows` rows of `old` bytes each to rows of `wide` bytes, the rest of which is zeros. */
static void widen(void *to, const void *from, int64_t rows, int64_t old, int64_t wide) {
    for (int64_t r = 0; r < rows; r++) {
        if (old) memcpy((uint8_t *)to + r * wide, (const uint8_t *)from + r * old, (size_t)old);
        memset((uint8_t *)to + r * wide + old, 0, (size_t)(wide - old));
    }
}

static void copy_indices(const TileState *old, TileState *out) {
    memset(out->indices, 0, 2 * (size_t)(out->known * out->stages));
    for (int64_t i = 0; i < old->known && old->stages; i++)
        memcpy(out->indices + i * out->stages, old->indices + i * old->stages, 2 * (size_t)old->stages);
}

/* A tile with `new` anchors more, whose numbers are zeros, and room for the stages of the models read; `old` is given
back. */
TileState *grown_tile(const Model *m, TileState *old, int64_t new) {
    TileState shape = *old;
    const int64_t before = old->known;
    if (!new && before && old->stages == m->most_stages) return old;
    shape.known += new, shape.stages = m->most_stages;
    TileState *out = memory_take(lay_out(m, &shape, NULL));
    lay_out(m, &shape, (uint8_t *)out);
    *out = shape;
    const int64_t n = out->known;
    widen(out->codes, old->codes, 1, 8 * before, 8 * n);
    widen(out->classes, old->classes, 1, before, n);
    for (int64_t c = 0; c < m->channels; c++) {
        const int64_t numbers = numbers_of(m, c), planes = m->channel[c].stream == OFFSETS ? 1 : numbers;
        const int64_t bytes = 4 * numbers / planes;
        widen(out->values[c], old->values[c], planes, bytes * before, bytes * n);
    }
    copy_indices(old, out);
    if (out->slots) widen(out->slots, old->slots, 1, m->slots * before, m->slots * n);
    memory_give(old);
    return out;
}

/* A tile of which nothing is decoded, by its record in the tile table (SPEC 5.4). */
TileState *new_tile(const Model *m, int64_t depth, int64_t shift, uint64_t prefix) {
    const int64_t bits = m->lattice_bits - depth - shift;
    demand(depth >= 0 && depth <= 21 && depth <= m->lattice_bits, "tile-depth");
    demand(shift >= 0 && shift <= 31, "tile-shift");
    demand(bits >= 0 && bits <= 21, "tile-local-bits");
    TileState *t = memory_take(sizeof *t);
    *t = (TileState){.depth = depth, .shift = shift, .bits = bits};
    for (int axis = 0; axis < 3; axis++) t->corner[axis] = coordinate(prefix >> axis) << (m->lattice_bits - depth);
    return t;
}
