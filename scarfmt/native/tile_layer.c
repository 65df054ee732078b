/* One layer of a tile (SPEC 7): decode_tile_layer, with the refusals of SPEC 12.2, step 8. */

#include <string.h>

#include "network.h"
#include "tile.h"

#define MOST_APPEAR 65536 /* anchors in a block */
#define BAD_BIN (-2)
#define BAD_SPLIT (-4)

int64_t *by_anchor(const Work *w, Pool *pool, const int64_t *by_class) {
    int64_t *out = pool_take(pool, 8 * w->t->known);
    for (int64_t i = 0; i < w->t->known; i++) out[i] = by_class[w->t->classes[i]];
    return out;
}

static void read_positions(Work *w) {
    Pool *pool = &channel_scratch;
    Rans rans = open_stream(w->parts[POSITIONS]);
    int64_t *numbers[8];
    pool_empty(pool, 1);
    for (int i = 0; i < 8; i++) numbers[i] = pool_take(pool, 8 * w->new);
    Positions p = {.total = w->new, .bits = w->t->bits, .codes = w->t->codes + w->t->known - w->new,
                   .open = pool_zeros(pool, w->new), .here = {numbers[0], numbers[1], (uint64_t *)numbers[2]},
                   .below = {numbers[3], numbers[4], (uint64_t *)numbers[5]}, .lower = numbers[6], .rest = numbers[7],
                   .counts = w->counts, .symbols = w->symbols, .order = w->order, .kind = w->kinds};
    const int64_t read = scar_positions(&rans, &p, w->layer->positions);
    demand(read < BAD_SPLIT || read > BAD_BIN, "bad-split");
    demand(read == ALL_READ, "missing-table");
    seal_stream(&rans);
}

static void read_classes(Work *w) {
    const int64_t first = w->m->rows[w->k - 1].classes, count = w->m->rows[w->k].classes - first;
    uint8_t *classes = w->t->classes + w->t->known - w->new;
    Rans rans = open_stream(w->parts[CLASSES]);
    if (count > 1) {
        memset(w->kinds, 0, 2 * (size_t)w->new);
        read_kinds(w, &rans, w->layer->classes, w->kinds, w->new);
    }
    demand(count > 0, "bad-class");
    for (int64_t i = 0; i < w->new; i++) {
        const int64_t place = count > 1 ? w->symbols[i] : 0;
        demand(place >= 0 && place < count, "bad-class");
        classes[i] = (uint8_t)(first + place);
    }
    seal_stream(&rans);
}

/* Which slots turn on (SPEC 7.4). */
static void read_masks(Work *w) {
    const int64_t n = w->t->known, slots = w->m->slots;
    int32_t *anchors = w->chosen;
    Rans rans = open_stream(w->parts[MASKS]);
    pool_empty(&channel_scratch, 1);
    uint8_t *on = pool_zeros(&channel_scratch, n);
    for (int64_t p = 0; p < n * slots; p++) on[p / slots] += w->t->slots[p] != 0;
    for (int64_t s = 0; s < slots; s++) {
        int64_t count = 0;
        for (int64_t i = 0; i < n; i++) {
            anchors[count] = (int32_t)i;
            w->kinds[count] = on[i];
            count += !w->t->slots[i * slots + s];
        }
        read_kinds(w, &rans, w->layer->masks, w->kinds, count);
        for (int64_t i = 0; i < count; i++) demand(w->symbols[i] == 0 || w->symbols[i] == 1, "bad-mask");
        for (int64_t i = 0; i < count; i++) {
            if (!w->symbols[i]) continue;
            w->t->slots[anchors[i] * slots + s] = (uint8_t)w->k;
            on[anchors[i]]++;
        }
    }
    seal_stream(&rans);
}

/* Anchors by (code, index): those of each layer are in that order. */
static void merge_codes(const Work *w) {
    const uint64_t *codes = w->t->codes;
    int64_t *order = w->by_code, *merged = pool_take(&layer_scratch, 8 * w->t->known), old = 0;
    for (int64_t layer = 1; layer <= w->k; layer++) {
        const int64_t all = old + w->t->appeared[layer];
        int64_t i = 0, j = old, made = 0;
        while (i < old && j < all) merged[made++] = codes[order[i]] <= codes[j] ? order[i++] : j++;
        while (i < old) merged[made++] = order[i++];
        while (j < all) merged[made++] = j++;
        memcpy(order, merged, 8 * (size_t)all);
        old = all;
    }
}

void look_at_cells(Work *w) {
    if (w->by_code) return;
    w->by_code = pool_take(&layer_scratch, 8 * w->t->known);
    merge_codes(w);
    for (int64_t d = 0; d < w->m->depths; d++) w->cell[d] = pool_take(&layer_scratch, 4 * w->t->known);
    scar_cells_names(w->t->codes, w->by_code, w->t->known, w->t->bits, w->m->targets, w->m->depths, w->cell, w->sizes);
}

Cells cells_of(const Work *w, Pool *pool, int64_t columns) {
    Cells cells = {.depths = w->m->depths, .columns = columns};
    for (int64_t d = 0; d < w->m->depths; d++) {
        cells.cell[d] = w->cell[d], cells.sizes[d] = w->sizes[d];
        cells.sums[d] = pool_take(pool, 8 * w->sizes[d] * (columns + 1));
        cells.means[d] = pool_take(pool, 4 * w->sizes[d] * fours(columns + 1));
    }
    return cells;
}

/* Indices by tables (SPEC 7.6). */
static void read_stage(Work *w, Rans *rans, int64_t stage) {
    const int64_t *before = w->m->rows[w->k - 1].stages, *after = w->m->rows[w->k].stages;
    const int64_t stages = w->t->stages, size = w->m->books[stage > 1].size;
    int32_t *chosen = w->chosen;
    int16_t *indices = w->t->indices;
    int64_t count = 0;
    for (int64_t i = 0; i < w->t->known; i++) {
        const int64_t class = w->t->classes[i];
        if (before[class] >= stage || after[class] < stage) continue;
        w->kinds[count] = (uint16_t)(CLASS_KINDS * class + (stage > 1 && !indices[i * stages + stage - 2]));
        chosen[count++] = (int32_t)i;
    }
    if (!count) return;
    read_kinds(w, rans, w->layer->indices[stage - 1], w->kinds, count);
    for (int64_t i = 0; i < count; i++) demand(w->symbols[i] >= 0 && w->symbols[i] < size, "bad-index");
    for (int64_t i = 0; i < count; i++) indices[chosen[i] * stages + stage - 1] = (int16_t)w->symbols[i];
}

static void read_indices(Work *w) {
    Rans rans = open_stream(w->parts[INDICES]);
    if (w->m->rows[w->k].mode)
        read_network_indices(w, &rans);
    else
        for (int64_t stage = 1; stage <= w->t->stages; stage++) read_stage(w, &rans, stage);
    seal_stream(&rans);
}

/* Memory for symbols: of all components of a channel together, or of all slots. */
static void lend(Work *w) {
    Pool *pool = &layer_scratch;
    int64_t most = 1;
    for (int64_t c = 0; c < w->m->channels; c++)
        most = w->m->channel[c].components > most ? w->m->channel[c].components : most;
    const int64_t kinds = most * KINDS, n = w->t->known;
    if (w->m->slots > most) most = w->m->slots;
    w->symbols = pool_take(pool, 4 * n * most), w->kinds = pool_take(pool, 2 * n * most);
    w->counts = pool_take(pool, 8 * (kinds + 1));
    w->chosen = pool_take(pool, 4 * n), w->order = pool_take(pool, 4 * n * most);
    if (w->layer->predicted || w->m->rows[w->k].mode) w->settled = pool_take(pool, 4 * n * w->m->attributes);
}

static int has_parts(const Work *w) {
    for (int stream = 0; stream < STREAM_KINDS; stream++)
        if (w->parts[stream].length) return 1;
    return 0;
}

void advance_tile(const Model *m, TileState *tile, Body block, int64_t appear, int64_t streams) {
    Work w = {.m = m, .t = tile, .k = tile->layer + 1, .new = appear, .streams = streams};
    demand(w.k <= m->layers, "missing-block");
    demand(appear >= 0 && appear <= MOST_APPEAR, "limit-tile-anchors");
    w.layer = m->layer + w.k;
    find_parts(&w, block);
    current->working = w.t = grown_tile(m, tile, appear);
    w.t->layer = w.k, w.t->appeared[w.k] = appear;
    if (!w.t->known && !has_parts(&w)) return;
    lend(&w);
    if (appear) read_positions(&w), read_classes(&w);
    if (m->profile == ANCHOR) read_masks(&w);
    read_channels(&w);
    if (streams >> INDICES & 1) read_indices(&w);
}
