/* Channels of a tile-layer (SPEC 7.5, 7.7, 10.3): those with static contexts in static_channels.c. */

#include "tile.h"

#define BAD_TRIT (-2)

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
                 .kind = w->kinds, .symbols = w->symbols, .order = w->order, .counts = w->counts};
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

static void read_channel(Work *w, int64_t channel) {
    const ChannelModel *model = w->m->channel + channel;
    pool_empty(&channel_scratch, 1);
    if (model->stream != OFFSETS && !(w->layer->predictors[channel] && w->t->known)) {
        read_static_channels(w, (int64_t[]){channel}, 1);
    } else {
        Rans rans = open_stream(w->parts[model->stream]);
        if (model->stream == OFFSETS) read_offsets(w, &rans, channel);
        else read_predicted(w, &rans, channel);
        seal_stream(&rans);
    }
    if (w->settled && is_attribute(model->stream)) settle(w, channel);
}

void read_channels(Work *w) {
    int64_t together[MOST_CHANNELS], count = 0;
    pool_empty(&channel_scratch, 1);
    for (int64_t c = 0; c < w->m->channels; c++) {
        const int64_t stream = w->m->channel[c].stream;
        if (!w->settled && stream != OFFSETS && w->streams >> stream & 1) together[count++] = c;
    }
    read_static_channels(w, together, count);
    for (int64_t c = 0; c < w->m->channels; c++) {
        const int64_t stream = w->m->channel[c].stream;
        if ((w->settled || stream == OFFSETS) && w->streams >> stream & 1) read_channel(w, c);
    }
}
