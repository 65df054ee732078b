/* Channels with static contexts (SPEC 7.5, 8.4). Each symbol of a sub-stream waits for the one before, but sub-streams do
not wait for each other: symbols of some of them are read in turns. */

#include <string.h>

#include "rans.h"
#include "tile.h"

#define LANES 3 /* sub-streams read in turns: as many as registers hold */

/* Symbols of one table of up to three: the values of anchors become factor * value + symbol. */
typedef struct {
    FewSymbols few;
    const int32_t *order;
    int64_t count;
    int32_t *plane, factor;
} Run;

/* A sub-stream on its way: the run to read next, and what comes after it. */
typedef struct {
    Run run;
    Rans rans;
    int64_t channel, step, component, kind, kinds; /* kind: the next one of `kinds` */
    int64_t taken, count;       /* classes whose anchors `chosen` holds, a bit each, -1: none yet; how many anchors */
    uint32_t past[TRIT_KINDS];  /* where each kind ends in `order` */
    int32_t *chosen, *order;
    int32_t *symbols;           /* of trits that are read carefully; NULL until some are */
    uint8_t *kind_of;
    int bad_trit, out_of_range; /* told when all components of the step are read */
    const char *fault;
} Lane;

/* Finds which anchors receive a step; those found last stay where the classes are the same. */
static void choose_anchors(const Work *w, Lane *s) {
    const int64_t *before = w->m->rows[w->k - 1].steps[s->channel], *after = w->m->rows[w->k].steps[s->channel];
    const uint8_t *classes = w->t->classes;
    int64_t taken = 0, count = 0;
    for (int64_t k = 0; k < CLASS_ROOM; k++) taken |= (int64_t)(before[k] < s->step && after[k] >= s->step) << k;
    if (taken == s->taken) return;
    for (int64_t i = 0; i < w->t->known; i++) {
        s->chosen[count] = (int32_t)i;
        count += taken >> classes[i] & 1;
    }
    s->taken = taken, s->count = count;
}

/* Context numbers of a component's symbols; whether its values leave room for one more trit. chosen: NULL for all. */
INLINE int put_kinds(const int32_t *restrict plane, const int32_t *restrict chosen, int64_t count,
                     uint8_t *restrict kind) {
    const int32_t room = (VALUE_LIMIT - 1) / 3;
    int outside = 0;
    for (int64_t i = 0; i < count; i++) {
        const int32_t value = plane[chosen ? chosen[i] : i];
        const int32_t low = value < -2 ? -2 : value;
        outside |= (value < -room) | (value > room);
        kind[i] = (uint8_t)((low > 2 ? 2 : low) + 2);
    }
    return !outside;
}

WIDE static int refined_kinds(const Lane *s, int64_t known, const int32_t *plane) {
    if (s->count == known) return put_kinds(plane, NULL, known, s->kind_of);
    return put_kinds(plane, s->chosen, s->count, s->kind_of);
}

/* The chosen anchors by ascending kind into `order`. Quarters in turns: a count that has just changed is slow to read
again. */
static __attribute__((noinline)) void sort_chosen(Lane *s) {
    const uint8_t *kind = s->kind_of;
    const int32_t *chosen = s->chosen;
    const int64_t quarter = s->count / 4;
    int32_t *order = s->order;
    uint32_t at[4][TRIT_KINDS], sum = 0;
    memset(at, 0, sizeof at);
    for (int64_t i = 0; i < quarter; i++)
        for (int p = 0; p < 4; p++) at[p][kind[p * quarter + i]]++;
    for (int64_t i = 4 * quarter; i < s->count; i++) at[3][kind[i]]++;
    for (int64_t k = 0; k < TRIT_KINDS; k++) {
        for (int p = 0; p < 4; p++) {
            const uint32_t some = at[p][k];
            at[p][k] = sum, sum += some;
        }
        s->past[k] = sum;
    }
    for (int64_t i = 0; i < quarter; i++)
        for (int p = 0; p < 4; p++) order[at[p][kind[p * quarter + i]]++] = chosen[p * quarter + i];
    for (int64_t i = 4 * quarter; i < s->count; i++) order[at[3][kind[i]]++] = chosen[i];
}

/* One symbol of each of the first lanes in turns, m times. */
INLINE void take_turns(Lane *lanes, int count, int64_t m) {
    Rans rans[LANES];
    Run run[LANES];
    for (int l = 0; l < count; l++) rans[l] = lanes[l].rans, run[l] = lanes[l].run;
    for (int64_t i = 0; i < m; i++)
#pragma GCC unroll 4
        for (int l = 0; l < count; l++) {
            int32_t *value = run[l].plane + run[l].order[i];
            *value = run[l].factor * *value + few_symbols(rans + l, &run[l].few);
        }
    for (int l = 0; l < count; l++) lanes[l].rans = rans[l], lanes[l].run.order += m, lanes[l].run.count -= m;
}

/* Not inlined, for registers of their own. */
static __attribute__((noinline)) void take_one(Lane *lanes, int64_t m) { take_turns(lanes, 1, m); }
static __attribute__((noinline)) void take_two(Lane *lanes, int64_t m) { take_turns(lanes, 2, m); }
static __attribute__((noinline)) void take_three(Lane *lanes, int64_t m) { take_turns(lanes, 3, m); }

static __attribute__((noinline)) void take_many(Lane *s, const StaticTable *many) {
    const StaticTable table = *many;
    const Run run = s->run;
    Rans local = s->rans;
    for (int64_t i = 0; i < run.count; i++) {
        int32_t *value = run.plane + run.order[i];
        *value = run.factor * *value + near_symbol(&local, &table);
    }
    s->rans = local, s->run.count = 0;
}

static int fails(Lane *s, const char *id) {
    s->fault = id;
    return 0;
}

static const StaticTable *table_of(const Work *w, const Lane *s, int64_t kind) {
    const LayerModel *layer = w->layer;
    return layer->tables[s->channel][s->step - layer->start[s->channel]]->table[s->component * KINDS + kind];
}

/* Makes the run of the next kind that occurs, symbols added to factor * value; tables of many symbols are read here.
Returns 0 where the component is over. */
static int next_kind(const Work *w, Lane *s, int32_t factor, int32_t *plane) {
    while (s->kind < s->kinds) {
        const uint32_t start = s->kind ? s->past[s->kind - 1] : 0, some = s->past[s->kind] - start;
        const StaticTable *table = table_of(w, s, s->kind++);
        if (!some) continue;
        s->run = (Run){table->few, (s->step > 1 ? s->order : s->chosen) + start, some, plane, factor};
        if (table->few.third) return 1;
        take_many(s, table);
    }
    return 0;
}

/* Trits that may be none, or carry values beyond their range: symbols first, then the sums in 64 bits. */
static void read_carefully(const Work *w, Lane *s, int32_t *plane) {
    if (!s->symbols) s->symbols = pool_zeros(&channel_scratch, 4 * w->t->known);
    int32_t *symbols = s->symbols;
    while (next_kind(w, s, 0, symbols)) take_one(s, s->run.count);
    for (int64_t i = 0; i < s->count; i++) {
        const int64_t anchor = s->chosen[i], trit = symbols[anchor], now = 3 * (int64_t)plane[anchor] + trit;
        s->bad_trit |= trit < -1 || trit > 1;
        s->out_of_range |= now < -VALUE_LIMIT || now > VALUE_LIMIT;
        plane[anchor] = (int32_t)now;
    }
}

static int trits_alone(const StaticTable *table) {
    return table->values[0] >= -1 && table->values[table->size - 1] <= 1;
}

/* Sorts the anchors of a component by kind; 0 where a table is missing. */
static int begin_component(const Work *w, Lane *s) {
    int32_t *plane = w->t->values[s->channel] + s->component * w->t->known;
    int plain = 1;
    s->kind = 0, s->kinds = s->step > 1 ? TRIT_KINDS : 1, s->past[0] = (uint32_t)s->count;
    if (s->step > 1) plain = refined_kinds(s, w->t->known, plane), sort_chosen(s);
    for (int64_t k = 0, at = 0; k < s->kinds; at = s->past[k++]) {
        if (s->past[k] == at) continue;
        const StaticTable *table = table_of(w, s, k);
        if (!table) return fails(s, "missing-table");
        plain &= s->step == 1 || trits_alone(table);
    }
    if (!plain) read_carefully(w, s, plane);
    return 1;
}

/* The next component of the next step that an anchor receives; 0 where there is none. */
static int next_component(const Work *w, Lane *s) {
    const LayerModel *layer = w->layer;
    if (s->count && ++s->component < w->m->channel[s->channel].components) return begin_component(w, s);
    if (s->bad_trit) return fails(s, "bad-trit");
    if (s->out_of_range) return fails(s, "value-range");
    s->component = 0, s->step++;
    for (; s->step < layer->stop[s->channel]; s->step++) {
        choose_anchors(w, s);
        if (s->count) return begin_component(w, s);
    }
    return 0;
}

static int next_run(const Work *w, Lane *s) {
    int32_t *plane;
    do {
        plane = w->t->values[s->channel] + s->component * w->t->known;
        if (next_kind(w, s, s->step > 1 ? 3 : 0, plane)) return 1;
    } while (next_component(w, s));
    return 0;
}

/* R-7.5-3. */
WIDE static int residuals_fit(const Work *w, int64_t channel) {
    const ChannelModel *residual = w->m->channel + channel;
    int outside = 0;
    for (int64_t c = 0; c < residual->components; c++) {
        const int32_t *plane = w->t->values[channel] + c * w->t->known;
        double widths[CLASS_ROOM];
        for (int64_t k = 0; k < CLASS_ROOM; k++)
            widths[k] = residual->widths[w->m->rows[w->k].steps[channel][k] * residual->components + c];
        for (int64_t i = 0; i < w->t->known; i++) {
            const double reach = plane[i] * widths[w->t->classes[i]];
            outside |= (reach < -1) | (reach > 1);
        }
    }
    return !outside;
}

static void begin(const Work *w, Lane *s, int64_t channel) {
    s->channel = channel, s->step = w->layer->start[channel] - 1;
    s->kind = s->kinds = s->component = s->count = s->run.count = 0, s->taken = -1;
    s->bad_trit = s->out_of_range = 0;
    s->fault = open_words(w->parts[w->m->channel[channel].stream], &s->rans);
}

static const char *end(const Work *w, const Lane *s) {
    const int64_t channel = s->channel;
    if (s->fault) return s->fault;
    if (s->rans.state || s->rans.left) return "rans-seal";
    /* What this layer leaves as it was has been checked. */
    if (w->m->channel[channel].stream != POSITION_RESIDUAL || w->layer->start[channel] == w->layer->stop[channel])
        return NULL;
    return residuals_fit(w, channel) ? NULL : "value-range";
}

static Lane new_lane(int64_t known) {
    Pool *pool = &channel_scratch;
    return (Lane){.chosen = pool_take(pool, 4 * known), .order = pool_take(pool, 4 * known),
                  .kind_of = pool_take(pool, known)};
}

/* Channels by the bytes of their sub-streams, the longest first: none is left over for long. */
static void sort_channels(const Work *w, int64_t *channels, int64_t count) {
    for (int64_t i = 1; i < count; i++)
        for (int64_t j = i; j && w->parts[w->m->channel[channels[j]].stream].length >
                                    w->parts[w->m->channel[channels[j - 1]].stream].length; j--) {
            const int64_t other = channels[j];
            channels[j] = channels[j - 1], channels[j - 1] = other;
        }
}

void read_static_channels(const Work *w, int64_t *channels, int64_t count) {
    const char *faults[MOST_CHANNELS] = {NULL};
    Lane lanes[LANES];
    int64_t live = 0, next = 0;
    sort_channels(w, channels, count);
    for (; live < LANES && next < count; live++) {
        lanes[live] = new_lane(w->t->known);
        begin(w, lanes + live, channels[next++]);
    }
    while (live) {
        int64_t m = INT64_MAX;
        for (int64_t l = 0; l < live;) {
            Lane *s = lanes + l;
            if (!s->run.count && (s->fault || !next_run(w, s))) {
                faults[s->channel] = end(w, s);
                if (next < count) begin(w, s, channels[next++]);
                else *s = lanes[--live];
                continue;
            }
            m = s->run.count < m ? s->run.count : m, l++;
        }
        if (live == 3) take_three(lanes, m);
        else if (live == 2) take_two(lanes, m);
        else if (live) take_one(lanes, m);
    }
    for (int64_t c = 0; c < w->m->channels; c++) demand(!faults[c], faults[c]);
}
