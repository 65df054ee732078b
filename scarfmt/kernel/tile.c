/* A whole tile, layer after layer (SPEC 7): what scarfmt/coding/tile.py defines, where nothing watches.

Nothing is said of what is wrong with a tile: whoever is told NOT_READ reads it again by the definition, which finds the
rule that is broken. Values are kept in planes, a component of all anchors after the other. */

#include <string.h>

#include "crc32.h"
#include "static_steps.h"

#define TILE_READ 0
#define NOT_READ 1

#define STREAM_POSITIONS 1
#define STREAM_CLASSES 2
#define STREAM_INDICES 9
#define MOST_RECORDS 11
#define RECORD_BYTES 9
#define STATIC 0
#define UNIFORM 1

typedef struct {
    const uint8_t *bytes; /* NULL: none */
    int64_t length;
} Part;

/* Memory of one call, and what is known while it runs. */
typedef struct {
    const TileModel *model;
    const Tile *tile;
    int64_t known, new; /* anchors after the layer; of these, the last `new` appear in it */
    StaticSteps statics;
    Part parts[STREAM_KINDS];
    CrcTable crc;
    uint32_t *words;
    int64_t *by_code, *merged, *steps, *before, *after, *chosen64, *anchors64, *counts;
    int32_t *plain, *first, *settled, *symbols, *cell[MOST_DEPTHS], *means[MOST_DEPTHS];
    int64_t settled_columns;
    double *sums[MOST_DEPTHS];
    int64_t sizes[MOST_DEPTHS], named;
    uint16_t *kind16;
    uint8_t *open;
    int32_t *rows, *inputs;
    int64_t *nodes[8];
} Work;

INLINE void *carved(uint8_t *base, int64_t *used, int64_t bytes) {
    void *at = base ? base + *used : NULL;
    *used += (bytes + 63) / 64 * 64;
    return at;
}

/* Whether a channel has predictors in some layer. */
static int64_t has_predictors(const TileModel *model, int64_t channel) {
    for (int64_t layer = 0; layer < model->layers; layer++)
        if (model->layer[layer].predictors[channel]) return 1;
    return 0;
}

/* The most components of a channel whose values go to rows: it has predictors, or those of others look at it. */
static int64_t most_in_rows(const TileModel *model) {
    int64_t most = 0;
    if (!model->predicted) return most;
    for (int64_t c = 0; c < model->channels; c++) {
        const TileChannel *channel = model->channel + c;
        if (channel->components > most && (channel->attribute || has_predictors(model, c))) most = channel->components;
    }
    return most;
}

/* Lays out the memory of a call from `base` on; returns the bytes taken. Without a base only these matter. */
static int64_t lay_out(Work *w, const TileModel *model, int64_t total, int64_t longest, uint8_t *base) {
    const int64_t attributes = model->attributes, in_rows = most_in_rows(model);
    int64_t used = 0, most = 1;
    for (int64_t c = 0; c < model->channels; c++)
        most = model->channel[c].components > most ? model->channel[c].components : most;
    const int64_t blocks = (total + BLOCK - 1) / BLOCK, row = channel_row_words(attributes, in_rows);
    const int64_t inputs = blocks * BLOCK * channel_input_words(attributes, in_rows, model->depths);
    const int64_t numbers = total * most;
    w->words = carved(base, &used, longest + 4);
    w->by_code = carved(base, &used, 8 * total), w->merged = carved(base, &used, 8 * total);
    w->steps = carved(base, &used, 8 * total), w->before = carved(base, &used, 8 * total);
    w->after = carved(base, &used, 8 * total), w->chosen64 = carved(base, &used, 8 * total);
    w->anchors64 = carved(base, &used, 8 * total);
    w->counts = carved(base, &used, 8 * (most * KINDS + 1));
    w->plain = carved(base, &used, 4 * total * in_rows), w->first = carved(base, &used, 4 * total * in_rows);
    w->settled = carved(base, &used, 4 * total * attributes);
    w->statics.chosen = carved(base, &used, 4 * total);
    w->statics.order = carved(base, &used, 4 * numbers), w->symbols = carved(base, &used, 4 * numbers);
    for (int64_t d = 0; d < model->depths; d++) {
        w->cell[d] = carved(base, &used, 4 * total);
        w->sums[d] = carved(base, &used, 8 * total * (in_rows + 1));
        w->means[d] = carved(base, &used, 4 * total * fours(in_rows + 1));
    }
    w->kind16 = carved(base, &used, 2 * numbers);
    w->statics.kind = carved(base, &used, total), w->open = carved(base, &used, total);
    w->rows = carved(base, &used, 4 * total * row), w->inputs = carved(base, &used, 4 * inputs);
    for (int k = 0; k < 8; k++) w->nodes[k] = carved(base, &used, 8 * total);
    return used;
}

/* Bytes of memory that scar_tile works in. `longest`: of a block. */
EXPORT int64_t scar_tile_memory(const TileModel *model, int64_t total, int64_t longest) {
    Work none;
    return lay_out(&none, model, total, longest, NULL);
}

/* Sub-streams (SPEC 7.1). */

static int64_t may_have(const TileModel *model, int64_t stream, int64_t new) {
    if (stream == STREAM_POSITIONS || stream == STREAM_CLASSES) return new > 0;
    if (stream == STREAM_INDICES) return 1;
    for (int64_t c = 0; c < model->channels; c++)
        if (model->channel[c].stream == stream) return 1;
    return 0;
}

static int64_t find_parts(Work *w, const TileBlock *block) {
    memset(w->parts, 0, sizeof w->parts);
    if (!block->bytes) return TILE_READ;
    const int64_t records = block->length ? block->bytes[0] : 0, table = 1 + RECORD_BYTES * records;
    if (records > MOST_RECORDS || table + 4 > block->length) return NOT_READ;
    if (crc32_of(w->crc, block->bytes, table) != little32(block->bytes + table)) return NOT_READ;
    const uint8_t *at = block->bytes + table + 4, *end = block->bytes + block->length;
    int64_t before = 0;
    for (const uint8_t *record = block->bytes + 1; record < block->bytes + table; record += RECORD_BYTES) {
        const int64_t stream = record[0], length = little32(record + 1);
        if (stream <= before || stream >= STREAM_KINDS || !length || length % 4 || length > end - at) return NOT_READ;
        if (!may_have(w->model, stream, block->count)) return NOT_READ;
        if (crc32_of(w->crc, at, length) != little32(record + 5)) return NOT_READ;
        w->parts[stream] = (Part){at, length};
        before = stream, at += length;
    }
    return at == end ? TILE_READ : NOT_READ;
}

static int64_t open_stream(Work *w, int64_t stream, Rans *rans) {
    const Part *part = w->parts + stream;
    const int64_t words = part->length / 4;
    for (int64_t i = 0; i < words; i++) w->words[i] = little32(part->bytes + 4 * i);
    *rans = (Rans){0, (uint64_t)words, w->words};
    if (words && !w->words[words - 1]) return NOT_READ;
    scar_rans_open(rans);
    return TILE_READ;
}

INLINE int64_t sealed(const Rans *rans) { return rans->state || rans->left ? NOT_READ : TILE_READ; }

INLINE void count_symbols(const Work *w, int64_t stream, int64_t coding, int64_t n) {
    w->tile->symbols[2 * stream + coding] += n;
}

/* Positions and classes of the anchors that appear (SPEC 7.2, 7.3). */

static int64_t read_positions(Work *w, const TileLayer *layer) {
    Rans rans;
    Positions p = {.total = w->new, .bits = w->tile->bits, .codes = w->tile->codes + w->known - w->new, .open = w->open};
    p.here = (Nodes){w->nodes[0], w->nodes[1], (uint64_t *)w->nodes[2]};
    p.below = (Nodes){w->nodes[3], w->nodes[4], (uint64_t *)w->nodes[5]};
    p.lower = w->nodes[6], p.rest = w->nodes[7], p.counts = w->counts;
    p.symbols = w->symbols, p.order = w->statics.order, p.kind = w->kind16;
    memset(p.codes, 0, 8 * (size_t)w->new);
    memset(p.open, 0, (size_t)w->new);
    if (open_stream(w, STREAM_POSITIONS, &rans)) return NOT_READ;
    if (scar_positions(&rans, &p, layer->positions) != ALL_READ) return NOT_READ;
    count_symbols(w, STREAM_POSITIONS, STATIC, p.static_read);
    count_symbols(w, STREAM_POSITIONS, UNIFORM, p.uniform_read);
    return sealed(&rans);
}

static int64_t read_classes(Work *w, const TileLayer *layer) {
    int64_t *classes = w->tile->classes + w->known - w->new;
    const int64_t kinds = layer->past_class - layer->first_class;
    Rans rans;
    if (open_stream(w, STREAM_CLASSES, &rans) || kinds < 1) return NOT_READ;
    if (kinds > 1) {
        memset(w->kind16, 0, 2 * (size_t)w->new);
        if (scar_rans_grouped(&rans, layer->classes, w->kind16, w->new, w->counts, w->statics.order, w->symbols) !=
            ALL_READ)
            return NOT_READ;
        count_symbols(w, STREAM_CLASSES, STATIC, w->new);
    }
    for (int64_t i = 0; i < w->new; i++) {
        const int64_t place = kinds > 1 ? w->symbols[i] : 0;
        if (place < 0 || place >= kinds) return NOT_READ;
        classes[i] = layer->first_class + place;
    }
    return sealed(&rans);
}

/* Anchors by (code, index): those known before are in that order, those that appear too. */
static void merge_codes(Work *w) {
    const uint64_t *codes = w->tile->codes;
    const int64_t old = w->known - w->new;
    int64_t i = 0, j = old, made = 0;
    while (i < old && j < w->known) {
        const int64_t next = codes[w->by_code[i]] <= codes[j] ? w->by_code[i++] : j++;
        w->merged[made++] = next;
    }
    while (i < old) w->merged[made++] = w->by_code[i++];
    while (j < w->known) w->merged[made++] = j++;
    int64_t *merged = w->merged;
    w->merged = w->by_code, w->by_code = merged;
}

/* Channels with static contexts (SPEC 7.5, 8.4). */

typedef struct {
    int64_t channel, step;
    int64_t count; /* anchors that receive the step: chosen[0..count - 1] */
    Rans rans;
} Step;

/* Reads one component's symbols of a step; kinds are filled in. */
static int64_t read_component(Work *w, Step *s, const Tables *tables, int64_t component, int32_t *plane) {
    uint32_t past[KINDS];
    sort_chosen(&w->statics, s->count, past);
    for (int64_t k = 0, at = 0; k < w->statics.kinds; at = past[k++]) {
        if (past[k] == at) continue;
        const int64_t number = component * KINDS + k, table = tables->number[number];
        if (table < 0 || (s->step > 1 && !trits_alone(tables, table))) return NOT_READ;
        tables->used[number] = 1;
        take_group(&s->rans, tables, number, w->statics.order + at, past[k] - at, s->step > 1 ? 3 : 0, plane);
    }
    return TILE_READ;
}

static void keep_first(const Work *w, const Step *s, int64_t component, const int32_t *plane) {
    int32_t *first = w->tile->first[s->channel];
    const int64_t columns = w->model->channel[s->channel].components;
    const int32_t *chosen = w->statics.chosen;
    if (!first) return;
    for (int64_t i = 0; i < s->count; i++) first[chosen[i] * columns + component] = plane[chosen[i]];
}

static int64_t read_step(Work *w, Step *s, const Tables *tables) {
    const TileChannel *channel = w->model->channel + s->channel;
    for (int64_t c = 0; c < channel->components; c++) {
        int32_t *plane = w->tile->values[s->channel] + c * w->tile->total;
        const Rule *rule = channel->rules + c;
        if (s->step == 1)
            first_kinds(&w->statics, s->count, rule, rule->source < 0 ? NULL : w->tile->first[rule->source]);
        else if (!refined_kinds(&w->statics, s->count, rule, plane))
            return NOT_READ;
        if (read_component(w, s, tables, c, plane)) return NOT_READ;
        if (s->step == 1) keep_first(w, s, c, plane);
    }
    count_symbols(w, channel->stream, STATIC, s->count * channel->components);
    return TILE_READ;
}

INLINE int64_t *received(const Work *w, int64_t layer, int64_t channel) {
    return w->tile->received + (layer * w->model->channels + channel) * (MOST_STEPS + 1);
}

static int64_t read_static(Work *w, int64_t number, Step *s, const int64_t *before) {
    const TileLayer *layer = w->model->layer + number;
    const int64_t c = s->channel;
    for (s->step = layer->start[c]; s->step < layer->stop[c]; s->step++) {
        s->count = choose_anchors(&w->statics, before, layer->steps[c], s->step);
        if (!s->count) continue;
        received(w, number, c)[s->step] = s->count;
        if (read_step(w, s, layer->tables[c][s->step - layer->start[c]])) return NOT_READ;
    }
    return TILE_READ;
}

/* Channels with predictors (SPEC 10.3): values go to rows for channel.c, and back. */

static void name_cells(Work *w) {
    const TileModel *model = w->model;
    if (w->named == w->known) return;
    scar_cells_names(w->tile->codes, w->by_code, w->known, w->tile->bits, model->targets, model->depths,
                     (int32_t *const *)w->cell, w->sizes);
    w->named = w->known;
}

static void to_rows(const Work *w, int64_t channel, int32_t *rows) {
    const int64_t columns = w->model->channel[channel].components;
    for (int64_t c = 0; c < columns; c++) {
        const int32_t *plane = w->tile->values[channel] + c * w->tile->total;
        for (int64_t i = 0; i < w->known; i++) rows[i * columns + c] = plane[i];
    }
}

static void from_rows(const Work *w, int64_t channel, const int32_t *rows) {
    const int64_t columns = w->model->channel[channel].components;
    for (int64_t c = 0; c < columns; c++) {
        int32_t *plane = w->tile->values[channel] + c * w->tile->total;
        for (int64_t i = 0; i < w->known; i++) plane[i] = rows[i * columns + c];
    }
}

static void put_steps(const Work *w, const int64_t *by_class, int64_t *out) {
    for (int64_t i = 0; i < w->known; i++) out[i] = by_class[w->tile->classes[i]];
}

static int64_t read_predicted(Work *w, int64_t number, Step *s, const int64_t *before) {
    const TileLayer *layer = w->model->layer + number;
    const TileChannel *channel = w->model->channel + s->channel;
    int32_t *first = w->tile->first[s->channel];
    name_cells(w);
    to_rows(w, s->channel, w->plain);
    put_steps(w, before, w->before);
    put_steps(w, layer->steps[s->channel], w->after);
    Channel c = {.count = w->known, .components = channel->components, .classes = w->tile->classes,
                 .values = w->plain, .first = first ? first : w->first, .steps = w->steps, .rules = channel->rules,
                 .sources = (const int32_t *const *)w->tile->first, .settled = w->settled,
                 .settled_columns = w->settled_columns, .settled_stride = w->model->attributes,
                 .rows = w->rows, .inputs = w->inputs, .kind = w->kind16, .symbols = w->symbols,
                 .order = w->statics.order, .counts = w->counts};
    c.cells.depths = w->model->depths, c.cells.columns = channel->components;
    for (int64_t d = 0; d < w->model->depths; d++)
        c.cells.cell[d] = w->cell[d], c.cells.sums[d] = w->sums[d], c.cells.sizes[d] = w->sizes[d],
        c.cells.means[d] = w->means[d];
    const ChannelLayer l = {.start = layer->start[s->channel], .stop = layer->stop[s->channel], .before = w->before,
                            .after = w->after, .by_code = w->by_code, .passes_log2 = w->model->passes_log2,
                            .tables = layer->tables[s->channel], .predictors = layer->predictors[s->channel],
                            .chosen = w->chosen64, .anchors = w->anchors64,
                            .read = received(w, number, s->channel) + layer->start[s->channel]};
    if (scar_channel_layer(&s->rans, &c, &l) != ALL_READ) return NOT_READ;
    for (int64_t step = l.start; step < l.stop; step++)
        count_symbols(w, channel->stream, STATIC, l.read[step - l.start] * channel->components);
    from_rows(w, s->channel, w->plain);
    return TILE_READ;
}

/* Fine values of an attribute channel, for predictors of channels after it (SPEC 10.2). */
static void settle(Work *w, const TileLayer *layer, int64_t channel) {
    const int64_t columns = w->model->channel[channel].components;
    to_rows(w, channel, w->plain);
    put_steps(w, layer->steps[channel], w->after);
    scar_fine(w->plain, w->after, w->known, columns, w->model->attributes, w->settled + w->settled_columns);
    w->settled_columns += columns;
}

/* Position residuals stay within a cell (SPEC 9.1). */
static int64_t within_reach(const Work *w, const TileLayer *layer, int64_t channel) {
    const TileChannel *residual = w->model->channel + channel;
    for (int64_t c = 0; c < residual->components; c++) {
        const int32_t *plane = w->tile->values[channel] + c * w->tile->total;
        for (int64_t i = 0; i < w->known; i++) {
            const int64_t steps = layer->steps[channel][w->tile->classes[i]];
            const double reach = plane[i] * residual->widths[steps * residual->components + c];
            if (reach < -1 || reach > 1) return 0;
        }
    }
    return 1;
}

static int64_t read_channel(Work *w, int64_t number, int64_t channel) {
    static const int64_t nothing[CLASS_ROOM] = {0};
    const TileLayer *layer = w->model->layer + number;
    const int64_t *before = number ? layer[-1].steps[channel] : nothing;
    Step s = {.channel = channel};
    if (open_stream(w, w->model->channel[channel].stream, &s.rans)) return NOT_READ;
    if (layer->start[channel] < layer->stop[channel]) {
        if (layer->predictors[channel] ? read_predicted(w, number, &s, before) : read_static(w, number, &s, before))
            return NOT_READ;
        if (w->model->channel[channel].residual && !within_reach(w, layer, channel)) return NOT_READ;
    }
    if (layer->predicted && w->model->channel[channel].attribute) settle(w, layer, channel);
    return sealed(&s.rans);
}

/* Indices by tables (SPEC 7.6). */

static int64_t read_stage(Work *w, const TileLayer *layer, int64_t stage, Rans *rans) {
    const int64_t width = w->model->stages, size = w->model->sizes[stage > 1];
    int64_t count = 0;
    for (int64_t i = 0; i < w->known; i++) {
        const int64_t kind = w->tile->classes[i];
        const int64_t before = layer == w->model->layer ? 0 : layer[-1].stages[kind];
        w->statics.chosen[count] = (int32_t)i;
        w->kind16[count] = (uint16_t)(CLASS_KINDS * kind);
        if (stage > 1) w->kind16[count] += w->tile->indices[i * width + stage - 2] == 0;
        count += before < stage && layer->stages[kind] >= stage;
    }
    if (!count) return TILE_READ;
    const int64_t read =
        scar_rans_grouped(rans, layer->indices[stage - 1], w->kind16, count, w->counts, w->statics.order, w->symbols);
    if (read != ALL_READ) return NOT_READ;
    count_symbols(w, STREAM_INDICES, STATIC, count);
    for (int64_t k = 0; k < count; k++) {
        if (w->symbols[k] < 0 || w->symbols[k] >= size) return NOT_READ;
        w->tile->indices[w->statics.chosen[k] * width + stage - 1] = (int16_t)w->symbols[k];
    }
    return TILE_READ;
}

static int64_t read_indices(Work *w, const TileLayer *layer) {
    int64_t stages = 0;
    Rans rans;
    for (int64_t k = 0; k < CLASS_ROOM; k++) stages = layer->stages[k] > stages ? layer->stages[k] : stages;
    if (open_stream(w, STREAM_INDICES, &rans)) return NOT_READ;
    for (int64_t stage = 1; stage <= stages; stage++)
        if (read_stage(w, layer, stage, &rans)) return NOT_READ;
    return sealed(&rans);
}

static int64_t read_layer(Work *w, int64_t number) {
    const TileBlock *block = w->tile->blocks + number;
    const TileLayer *layer = w->model->layer + number;
    w->new = block->count, w->known += block->count, w->settled_columns = 0;
    w->statics.known = w->known, w->statics.kinds = CLASS_KINDS * layer->past_class, w->statics.taken = -1;
    if (!block->bytes && !w->known) return TILE_READ;
    if (find_parts(w, block)) return NOT_READ;
    if (w->new && (read_positions(w, layer) || read_classes(w, layer))) return NOT_READ;
    if (w->model->predicted) merge_codes(w);
    for (int64_t channel = 0; channel < w->model->channels; channel++)
        if (read_channel(w, number, channel)) return NOT_READ;
    return read_indices(w, layer);
}

/* Reads all layers of a tile: TILE_READ, or NOT_READ and its arrays hold anything. */
EXPORT int64_t scar_tile(const TileModel *model, const Tile *tile, int64_t longest, uint8_t *memory) {
    Work w = {.model = model, .tile = tile, .named = -1, .statics.classes = tile->classes};
    lay_out(&w, model, tile->total, longest, memory);
    crc32_table(w.crc);
    for (int64_t c = 0; c < model->channels; c++) {
        const size_t numbers = (size_t)(tile->total * model->channel[c].components);
        memset(tile->values[c], 0, 4 * numbers);
        if (tile->first[c]) memset(tile->first[c], 0, 4 * numbers);
    }
    memset(tile->indices, 0, 2 * (size_t)(tile->total * model->stages));
    for (int64_t number = 0; number < model->layers; number++)
        if (read_layer(&w, number)) return NOT_READ;
    return w.known == tile->total ? TILE_READ : NOT_READ;
}
