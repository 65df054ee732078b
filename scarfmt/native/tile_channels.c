/* Channels of a tile-layer (SPEC 7.5, 7.7, 10.3). */

#include "static_steps.h"
#include "tile.h"

#define BAD_TRIT (-2)

/* What is wrong with the values of a step: told when all its components are read. */
typedef struct {
    int bad_trit, out_of_range;
} Faults;

/* Anchors of one component's step, kind by kind: the one context of a first step, or those of trits. */
typedef struct {
    const int32_t *order;
    uint32_t past[TRIT_KINDS]; /* where each kind ends */
    int64_t kinds;
} Groups;

/* Trits that may be none, or carry values beyond their range: symbols first, then the sums in 64 bits. */
static void read_carefully(Work *w, Rans *rans, const Tables *tables, int64_t component, const Groups *groups,
                           int64_t count, int32_t *plane, Faults *faults) {
    int32_t *symbols = pool_zeros(&channel_scratch, 4 * w->t->known);
    for (int64_t k = 0, at = 0; k < groups->kinds; at = groups->past[k++])
        if (groups->past[k] > at)
            take_group(rans, tables->table[component * KINDS + k], groups->order + at, groups->past[k] - at, 0, symbols);
    for (int64_t i = 0; i < count; i++) {
        const int64_t anchor = w->statics.chosen[i], trit = symbols[anchor], now = 3 * (int64_t)plane[anchor] + trit;
        faults->bad_trit |= trit < -1 || trit > 1;
        faults->out_of_range |= now < -VALUE_LIMIT || now > VALUE_LIMIT;
        plane[anchor] = (int32_t)now;
    }
}

/* One component of a step. */
static void read_component(Work *w, Rans *rans, const Tables *tables, int64_t component, int64_t step, int64_t count,
                           int32_t *plane, Faults *faults) {
    Groups groups = {w->statics.chosen, {(uint32_t)count}, 1};
    int plain = 1;
    if (step > 1) {
        plain = refined_kinds(&w->statics, count, plane);
        groups.order = w->statics.order, groups.kinds = TRIT_KINDS;
        sort_chosen(&w->statics, count, groups.past);
    }
    for (int64_t k = 0, at = 0; k < groups.kinds; at = groups.past[k++]) {
        if (groups.past[k] == at) continue;
        const StaticTable *table = tables->table[component * KINDS + k];
        demand(table != NULL, "missing-table");
        plain &= step == 1 || trits_alone(table);
    }
    if (!plain) {
        read_carefully(w, rans, tables, component, &groups, count, plane, faults);
        return;
    }
    for (int64_t k = 0, at = 0; k < groups.kinds; at = groups.past[k++])
        if (groups.past[k] > at)
            take_group(rans, tables->table[component * KINDS + k], groups.order + at, groups.past[k] - at,
                       step > 1 ? 3 : 0, plane);
}

static void read_step(Work *w, Rans *rans, int64_t channel, int64_t step, const Tables *tables, int64_t count) {
    Faults faults = {0, 0};
    for (int64_t c = 0; c < w->m->channel[channel].components; c++)
        read_component(w, rans, tables, c, step, count, w->t->values[channel] + c * w->t->known, &faults);
    demand(!faults.bad_trit, "bad-trit");
    demand(!faults.out_of_range, "value-range");
}

static void read_static(Work *w, Rans *rans, int64_t channel) {
    const LayerModel *layer = w->layer;
    const int64_t *before = w->m->rows[w->k - 1].steps[channel], *after = w->m->rows[w->k].steps[channel];
    for (int64_t step = layer->start[channel]; step < layer->stop[channel]; step++) {
        const int64_t count = choose_anchors(&w->statics, before, after, step);
        if (count) read_step(w, rans, channel, step, layer->tables[channel][step - layer->start[channel]], count);
    }
}

/* Channels with predictors: values go to rows, and back. */

static int32_t *to_rows(const Work *w, int64_t channel) {
    const int64_t columns = w->m->channel[channel].components, n = w->t->known;
    int32_t *rows = pool_take(&channel_scratch, 4 * n * columns);
    for (int64_t c = 0; c < columns; c++) {
        const int32_t *plane = w->t->values[channel] + c * n;
        for (int64_t i = 0; i < n; i++) rows[i * columns + c] = plane[i];
    }
    return rows;
}

static void from_rows(const Work *w, int64_t channel, const int32_t *rows) {
    const int64_t columns = w->m->channel[channel].components, n = w->t->known;
    for (int64_t c = 0; c < columns; c++) {
        int32_t *plane = w->t->values[channel] + c * n;
        for (int64_t i = 0; i < n; i++) plane[i] = rows[i * columns + c];
    }
}

static void read_predicted(Work *w, Rans *rans, int64_t channel) {
    Pool *pool = &channel_scratch;
    const LayerModel *layer = w->layer;
    const ChannelModel *model = w->m->channel + channel;
    const int64_t n = w->t->known, components = model->components, settled = w->settled_columns;
    const int64_t blocks = (n + BLOCK - 1) / BLOCK, inputs = channel_input_words(settled, components, w->m->depths);
    look_at_cells(w);
    Channel c = {.count = n, .components = components, .classes = w->t->classes, .values = to_rows(w, channel),
                 .settled = w->settled, .settled_columns = settled, .settled_stride = w->m->attributes, .cells = cells_of(w, pool, components),
                 .kind = w->kinds, .symbols = w->symbols, .order = w->statics.order, .counts = w->counts};
    c.steps = pool_take(pool, 8 * n);
    c.rows = pool_take(pool, 4 * n * channel_row_words(settled, components));
    c.inputs = pool_take(pool, 4 * BLOCK * blocks * inputs);
    const ChannelLayer l = {.start = layer->start[channel], .stop = layer->stop[channel],
                            .before = by_anchor(w, pool, w->m->rows[w->k - 1].steps[channel]),
                            .after = by_anchor(w, pool, w->m->rows[w->k].steps[channel]),
                            .by_code = w->by_code, .passes_log2 = w->m->passes_log2,
                            .tables = layer->tables[channel], .predictors = layer->predictors[channel],
                            .chosen = pool_take(pool, 8 * n), .anchors = pool_take(pool, 8 * n)};
    const int64_t found = scar_channel_layer(rans, &c, &l);
    demand(found != BAD_TRIT, "bad-trit");
    demand(found == ALL_READ || found >= 0, "value-range");
    demand(found == ALL_READ, "missing-table");
    from_rows(w, channel, c.values);
}

/* R-7.5-3. */
static void check_residuals(const Work *w, int64_t channel) {
    const ChannelModel *residual = w->m->channel + channel;
    const LayerModel *layer = w->layer;
    /* What this layer leaves as it was has been checked. */
    if (layer->start[channel] == layer->stop[channel]) return;
    for (int64_t c = 0; c < residual->components; c++) {
        const int32_t *plane = w->t->values[channel] + c * w->t->known;
        double widths[CLASS_ROOM];
        int outside = 0;
        for (int64_t k = 0; k < MOST_CLASSES; k++)
            widths[k] = residual->widths[w->m->rows[w->k].steps[channel][k] * residual->components + c];
        for (int64_t i = 0; i < w->t->known; i++) {
            const double reach = plane[i] * widths[w->t->classes[i]];
            outside |= (reach < -1) | (reach > 1);
        }
        demand(!outside, "value-range");
    }
}

/* Fine values of an attribute channel, which what comes after it looks at (SPEC 10.2). */
static void settle(Work *w, int64_t channel) {
    const int64_t columns = w->m->channel[channel].components;
    const int64_t *steps = by_anchor(w, &channel_scratch, w->m->rows[w->k].steps[channel]);
    scar_fine(to_rows(w, channel), steps, w->t->known, columns, w->m->attributes, w->settled + w->settled_columns);
    w->settled_columns += columns;
}

/* Offsets of the slots that turn on (SPEC 7.7). */
static void read_offsets(Work *w, Rans *rans, int64_t channel) {
    const ChannelModel *model = w->m->channel + channel;
    const int64_t places = w->t->known * w->m->slots;
    int64_t count = 0;
    int32_t *pairs = pool_take(&channel_scratch, 4 * places);
    for (int64_t p = 0; p < places; p++)
        if (w->t->slots[p] == w->k) pairs[count++] = (int32_t)p;
    for (int64_t c = 0; c < model->components; c++) {
        for (int64_t i = 0; i < count; i++) w->kinds[i] = (uint16_t)(c * KINDS);
        read_kinds(w, rans, w->layer->tables[channel][0], w->kinds, count);
        for (int64_t i = 0; i < count; i++) w->t->values[channel][pairs[i] * model->components + c] = w->symbols[i];
    }
}

void read_tile_channel(Work *w, int64_t channel) {
    const ChannelModel *model = w->m->channel + channel;
    Rans rans = open_stream(w, model->stream);
    pool_empty(&channel_scratch, 1);
    if (model->stream == OFFSETS)
        read_offsets(w, &rans, channel);
    else if (w->layer->predictors[channel] && w->t->known)
        read_predicted(w, &rans, channel);
    else
        read_static(w, &rans, channel);
    seal_stream(&rans);
    if (model->stream == POSITION_RESIDUAL) check_residuals(w, channel);
    if (w->settled && is_attribute(model->stream)) settle(w, channel);
}
