/* Channel steps with static contexts and predictors (SPEC 7.5, 10.3): what scarfmt/codecs/channels.py and
scarfmt/neural/predictors.py define. */

#include <string.h>

#include "cells.h"
#include "products.h"
#include "rans.h"
#include "steps.h"

#define MOST_COMPONENTS 64
#define TILE 64       /* anchors whose values stay in the cache while component after component is looked at */
#define BAD_TRIT (-2)
#define VALUE_RANGE (-3)
#define MANY_SYMBOLS (-4)

INLINE int64_t row_words(const Channel *s) { return channel_row_words(s->settled_columns, s->components); }

INLINE int64_t shared_words(const Channel *s) {
    return shared_input_words(s->settled_columns, s->components, s->cells.depths);
}

INLINE int64_t block_words(const Channel *s) {
    return channel_input_words(s->settled_columns, s->components, s->cells.depths);
}

INLINE int32_t clamped(int32_t value) { return value < -AMAX ? -AMAX : value > AMAX ? AMAX : value; }

INLINE int32_t coarse_input(int32_t fine) { return clamped(fine >> 6); }

/* Classes and settled values of all rows. */
WIDE static void fill_known(const Channel *s) {
    const int64_t words = row_words(s), columns = s->settled_columns;
    for (int64_t i = 0; i < s->count; i++) {
        int32_t *row = s->rows + i * words;
        const int32_t *settled = s->settled + i * s->settled_stride;
        row[0] = (int32_t)s->classes[i];
        for (int64_t k = 0; k + 1 < columns; k += 2)
            row[1 + k / 2] = pair_of(coarse_input(settled[k]), coarse_input(settled[k + 1]));
        if (columns % 2) row[1 + columns / 2] = pair_of(coarse_input(settled[columns - 1]), 0);
    }
}

/* Fine values of all rows, at the step where each anchor is. */
INLINE void fill_own_of(const Channel *s, int64_t components) {
    const int64_t words = row_words(s);
    int32_t *out = s->rows + 1 + pairs_of(s->settled_columns), fine[MOST_COMPONENTS * BLOCK];
    for (int64_t i = 0; i < s->count; i += BLOCK) {
        const int64_t some = s->count - i < BLOCK ? s->count - i : BLOCK;
        int64_t same = 1;
        while (same < some && s->steps[i + same] == s->steps[i]) same++;
        if (same == some)
            fine_run(s->values + i * components, some * components, s->steps[i], fine);
        else
            for (int64_t j = 0; j < some; j++)
                fine_run(s->values + (i + j) * components, components, s->steps[i + j], fine + j * components);
        for (int64_t j = 0; j < some; j++, out += words)
            for (int64_t c = 0; c < components; c++) out[c] = fine[j * components + c];
    }
}

WIDE static void fill_own(const Channel *s) {
    if (s->components == 3)
        fill_own_of(s, 3);
    else
        fill_own_of(s, s->components);
}

/* What the rows of a block hold: words from `x` on, and fine values. */
INLINE void row_inputs(const Channel *s, const int64_t *anchors, int32_t *x, int32_t own[][BLOCK]) {
    const int64_t words = row_words(s), known = 1 + pairs_of(s->settled_columns);
    const int32_t *rows[BLOCK];
    int32_t four[4][BLOCK];
    for (int j = 0; j < BLOCK; j++) rows[j] = s->rows + anchors[j] * words;
    for (int64_t at = 0; at < words; at += 4) {
        four_columns(rows, at, four);
        for (int64_t k = at; k < at + 4; k++)
            memcpy(k < known ? x + k * BLOCK : own[k - known], four[k - at], sizeof four[0]);
    }
}

/* The (block_words, BLOCK) inputs of a block of anchors (SPEC 10.3). */
INLINE void block_inputs(const Channel *s, const int64_t *anchors, int32_t *x) {
    const int64_t components = s->components, own_stride = pairs_of(s->cells.depths) * BLOCK;
    /* Differences beyond `reach` are inputs of AMAX; nearer ones fit 32 bits times the power. */
    const int32_t power = (int32_t)power_of(s->step), reach = 32 * (AMAX + 1) / power + 1;
    int32_t own[MOST_COMPONENTS + 4][BLOCK], mean[MOST_COMPONENTS + 4][BLOCK], in[MOST_COMPONENTS + 2][BLOCK];
    int32_t *relative = x + (1 + shared_words(s)) * BLOCK;
    row_inputs(s, anchors, x, own);
    x += (1 + pairs_of(s->settled_columns)) * BLOCK;
    for (int64_t c = 0; c < components; c++)
        for (int j = 0; j < BLOCK; j++) in[c][j] = coarse_input(own[c][j]);
    memset(in[components], 0, sizeof in[0]);
    memset(mean, 0, (size_t)components * sizeof mean[0]);
    for (int64_t c = 0; c < components; c += 2, x += BLOCK) put_pairs(in[c], in[c + 1], x);
    for (int64_t d = 0; d < s->cells.depths; d++) {
        mean_columns(&s->cells, d, anchors, mean);
        for (int64_t c = 0; c < components; c++) {
            int32_t *restrict apart = relative + c * own_stride + d / 2 * BLOCK;
            for (int j = 0; j < BLOCK; j++) in[c][j] = coarse_input(mean[c][j]);
            for (int j = 0; j < BLOCK; j++) {
                const int32_t far = mean[c][j] - own[c][j];
                const int32_t near = far < -reach ? -reach : far > reach ? reach : far;
                const int32_t input = clamped((near * power + 16) >> 5);
                apart[j] = d % 2 ? pair_of(apart[j], input) : pair_of(input, 0);
            }
        }
        memcpy(in[components], mean[components], sizeof in[0]);
        memset(in[components + 1], 0, sizeof in[0]);
        for (int64_t c = 0; c <= components; c += 2, x += BLOCK) put_pairs(in[c], in[c + 1], x);
    }
}

/* Inputs of all blocks of a pass. */
WIDE static void pass_inputs(const Channel *s, const int64_t *anchors, int64_t wide) {
    int64_t block[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        block_anchors(anchors, wide, i, block);
        block_inputs(s, block, s->inputs + i * block_words(s));
    }
}

/* Context numbers of components first..past - 1 that have a predictor; in step 1 of the inputs of the whole pass, else
block by block. */
WIDE static void predict(const Channel *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    const Products *products = products_at_hand();
    const int64_t relative = (1 + shared_words(s)) * BLOCK, own_stride = pairs_of(s->cells.depths) * BLOCK;
    int64_t block[BLOCK];
    int32_t context[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        int32_t *x = s->inputs;
        if (s->step == 1) {
            x += i * block_words(s);
        } else {
            block_anchors(anchors, wide, i, block);
            block_inputs(s, block, x);
        }
        const int64_t here = wide - i < BLOCK ? wide - i : BLOCK;
        for (int64_t c = first; c < past; c++) {
            if (!s->predictors[c].rows) continue;
            products->contexts(s->predictors + c, x + BLOCK, x + relative + c * own_stride, x, context);
            uint16_t *kind = s->kind + (c - first) * wide + i;
            for (int64_t j = 0; j < here; j++) kind[j] = (uint16_t)(context[j] + (c - first) * KINDS);
        }
    }
}

/* Context numbers of a component from anchor `from` to `to` of a pass without a predictor (SPEC 8.4). */
static void static_kinds(const Channel *s, int64_t component, const int64_t *anchors, int64_t from, int64_t to,
                         int64_t base, uint16_t *kind) {
    for (int64_t i = from; i < to; i++) {
        const int32_t value = s->values[anchors[i] * s->components + component];
        kind[i] = (uint16_t)(base + (s->step == 1 ? 0 : (value < -2 ? -2 : value > 2 ? 2 : value) + 2));
    }
}

/* Kinds of the symbols of components first..past - 1 of a pass. */
static void put_kinds(const Channel *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    if (s->predictors) predict(s, anchors, wide, first, past);
    for (int64_t from = 0; from < wide; from += TILE) {
        const int64_t to = from + TILE < wide ? from + TILE : wide;
        for (int64_t c = first; c < past; c++)
            if (!s->predictors || !s->predictors[c].rows)
                static_kinds(s, c, anchors, from, to, (c - first) * KINDS, s->kind + (c - first) * wide);
    }
}

/* Symbols of components first..past - 1 of a pass, n together, from a stream: ALL_READ or a kind without a table. */
static int64_t read_symbols(Rans *rans, const Channel *s, int64_t n, int64_t first, int64_t past) {
    /* Kinds of these components alone: clearing and walking those of all would take longer than reading few. */
    Tables tables = *s->tables;
    tables.kinds = (past - first) * KINDS;
    tables.table += first * KINDS;
    const int64_t read = scar_rans_grouped(rans, &tables, s->kind, n, s->counts, s->order, s->symbols);
    return read == ALL_READ ? read : read + first * KINDS;
}

/* Where the symbols of each kind begin; of those in the second half of each component's, in `later`. Whether all have
a table of up to three symbols. */
INLINE int kinds_begin(const Tables *tables, int64_t kinds, uint32_t *here, uint32_t *later) {
    uint32_t total = 0;
    int other = 0;
    for (int64_t k = 0; k < kinds; k++) {
        const uint32_t some = here[k], all = some + later[k];
        other |= all && (!tables->table[k] || !tables->table[k]->few.third);
        here[k] = total, later[k] = total + some;
        total += all;
    }
    return !other;
}

/* Puts the places of a pass's values, and their kinds, in the order in which symbols travel: by kind. 0 where a kind has
no table of few symbols. Halves of each component in turns: a count that has just changed is slow to read again. */
static int sort_trits(const Channel *s, const int64_t *anchors, int64_t wide, int32_t *places, int32_t *kinds_in_order) {
    const int64_t components = s->components, half = wide / 2, kinds = components * KINDS;
    uint32_t *here = (uint32_t *)s->counts, *later = here + kinds;
    memset(here, 0, 2 * (size_t)kinds * sizeof *here);
    for (int64_t c = 0; c < components; c++) {
        const uint16_t *one = s->kind + c * wide, *other = one + half;
        for (int64_t i = 0; i < half; i++) here[one[i]]++, later[other[i]]++;
        if (wide % 2) later[other[half]]++;
    }
    if (!kinds_begin(s->tables, kinds, here, later)) return 0;
    for (int64_t c = 0; c < components; c++) {
        const uint16_t *one = s->kind + c * wide, *other = one + half;
        for (int64_t i = 0; i < wide - half; i++) {
            if (i < half) {
                const uint32_t at = here[one[i]]++;
                places[at] = (int32_t)(anchors[i] * components + c), kinds_in_order[at] = one[i];
            }
            const uint32_t at = later[other[i]]++;
            places[at] = (int32_t)(anchors[half + i] * components + c), kinds_in_order[at] = other[i];
        }
    }
    return 1;
}

/* Reads the trits of a pass into its values: ALL_READ, BAD_TRIT, VALUE_RANGE, or MANY_SYMBOLS where nothing is read
since a table is missing or has more than three symbols. */
static int64_t read_trits(Rans *rans, const Channel *s, const int64_t *anchors, int64_t wide) {
    const int64_t n = s->components * wide;
    if (!sort_trits(s, anchors, wide, s->order, s->symbols)) return MANY_SYMBOLS;
    Rans local = *rans;
    int outside = 0;
    uint32_t most = 0;
    for (int64_t i = 0; i < n; i++) {
        const int32_t symbol = few_symbols(&local, &s->tables->table[s->symbols[i]]->few);
        const int64_t now = symbol + 3 * (int64_t)s->values[s->order[i]];
        const uint32_t place = (uint32_t)symbol + 1;
        most = place > most ? place : most;
        outside |= now < -VALUE_LIMIT || now > VALUE_LIMIT;
        s->values[s->order[i]] = (int32_t)now;
    }
    *rans = local;
    return most > 2 ? BAD_TRIT : outside ? VALUE_RANGE : ALL_READ;
}

static int all_trits(const int32_t *symbols, int64_t n) {
    uint32_t most = 0;
    for (int64_t i = 0; i < n; i++) {
        const uint32_t place = (uint32_t)symbols[i] + 1;
        most = place > most ? place : most;
    }
    return most <= 2;
}

/* Values of components first..past - 1 of a pass, from their symbols; whether all are of 32 bits. */
static int put_values(const Channel *s, const int32_t *symbols, const int64_t *anchors, int64_t wide, int64_t first,
                      int64_t past) {
    const int64_t factor = s->step > 1 ? 3 : 0;
    int outside = 0;
    for (int64_t from = 0; from < wide; from += TILE) {
        const int64_t to = from + TILE < wide ? from + TILE : wide;
        for (int64_t c = first; c < past; c++)
            for (int64_t i = from; i < to; i++) {
                const int64_t at = anchors[i] * s->components + c;
                const int64_t now = symbols[(c - first) * wide + i] + factor * s->values[at];
                outside |= now < -VALUE_LIMIT || now > VALUE_LIMIT;
                s->values[at] = (int32_t)now;
            }
    }
    return !outside;
}

/* Reads components first..past - 1 of a pass; ALL_READ or what is wrong. */
static int64_t read_components(Rans *rans, Channel *s, const int64_t *anchors, int64_t wide, int64_t first,
                               int64_t past) {
    const int64_t n = (past - first) * wide;
    put_kinds(s, anchors, wide, first, past);
    const int64_t trits = s->step > 1 ? read_trits(rans, s, anchors, wide) : MANY_SYMBOLS;
    if (trits != MANY_SYMBOLS) return trits;
    const int64_t read = read_symbols(rans, s, n, first, past);
    if (read != ALL_READ) return read;
    if (s->step > 1 && !all_trits(s->symbols, n)) return BAD_TRIT;
    return put_values(s, s->symbols, anchors, wide, first, past) ? ALL_READ : VALUE_RANGE;
}

/* In step 1, what was just read is an input of the components after it: 16 times the value. */
WIDE static void tell_component(const Channel *s, int64_t component, const int64_t *anchors, int64_t wide) {
    const int64_t size = block_words(s), column = 1 + pairs_of(s->settled_columns) + component / 2;
    int64_t block[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        int32_t *restrict x = s->inputs + i * size + column * BLOCK;
        block_anchors(anchors, wide, i, block);
        for (int j = 0; j < BLOCK; j++) {
            const int32_t value = s->values[block[j] * s->components + component];
            const int32_t input = clamped((value < -AMAX ? -AMAX : value > AMAX ? AMAX : value) * 16);
            x[j] = component % 2 ? pair_of(x[j], input) : pair_of(input, 0);
        }
    }
}

/* Adds the row of an anchor to its cells. */
INLINE void add_row(const Channel *s, int64_t anchor, int64_t components) {
    const int32_t *row = s->rows + anchor * row_words(s) + 1 + pairs_of(s->settled_columns);
    for (int64_t d = 0; d < s->cells.depths; d++) {
        double *sums = s->cells.sums[d] + s->cells.cell[d][anchor] * (components + 1);
        for (int64_t c = 0; c < components; c++) sums[c] += row[c];
        sums[components] += 1;
    }
}

/* Brings the rows of a pass, all of which have the step, up to date, and adds them to the cells. */
INLINE void add_pass_of(const Channel *s, const int64_t *anchors, int64_t wide, int64_t components) {
    const int64_t words = row_words(s);
    int32_t *own = s->rows + 1 + pairs_of(s->settled_columns), value[MOST_COMPONENTS * BLOCK], fine[MOST_COMPONENTS * BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        const int64_t some = wide - i < BLOCK ? wide - i : BLOCK;
        for (int64_t j = 0; j < some; j++)
            for (int64_t c = 0; c < components; c++)
                value[j * components + c] = s->values[anchors[i + j] * components + c];
        fine_run(value, some * components, s->step, fine);
        for (int64_t j = 0; j < some; j++) {
            for (int64_t c = 0; c < components; c++) own[anchors[i + j] * words + c] = fine[j * components + c];
            add_row(s, anchors[i + j], components);
        }
    }
}

WIDE static void add_pass(const Channel *s, const int64_t *anchors, int64_t wide) {
    if (s->components == 3)
        add_pass_of(s, anchors, wide, 3);
    else
        add_pass_of(s, anchors, wide, s->components);
}

/* The cells with the anchors that have the step already. */
INLINE void fill_cells_of(const Channel *s, int64_t components) {
    empty_cells(&s->cells);
    for (int64_t anchor = 0; anchor < s->count; anchor++)
        if (s->steps[anchor] >= s->step) add_row(s, anchor, components);
}

WIDE static void fill_cells(const Channel *s) {
    if (s->components == 3)
        fill_cells_of(s, 3);
    else
        fill_cells_of(s, s->components);
}

/* What the inputs of a pass are made of: means of the cells, and in step 1 the inputs themselves. */
WIDE static void means_of_pass(const Channel *s, const int64_t *anchors, int64_t wide) {
    fill_means(&s->cells);
    if (s->step == 1) pass_inputs(s, anchors, wide);
}

/* Rows and cells before a step. */
static void look_around(Channel *s) {
    if (!s->rows_step) fill_known(s);
    if (!s->rows_step || s->rows_step != s->step - 1) fill_own(s);
    s->rows_step = s->step;
    fill_cells(s);
}

/* Reads the step of a channel that `s` names, pass by pass (SPEC 7.5, 10.3); `ends`: where each pass ends
among the anchors.

Returns ALL_READ, BAD_TRIT, VALUE_RANGE, or a kind (component * 256 + context) without a table. */
static int64_t channel_step(Rans *rans, Channel *s, const int64_t *anchors, const int64_t *ends, int64_t passes) {
    if (s->predictors) look_around(s);
    for (int64_t pass = 0, start = 0; pass < passes; start = ends[pass++]) {
        const int64_t *here = anchors + start;
        const int64_t wide = ends[pass] - start;
        if (!wide) continue;
        if (s->predictors) means_of_pass(s, here, wide);
        /* The components of a first step are context for each other; later steps need no component's news. */
        const int64_t together = s->step == 1 ? 1 : s->components;
        for (int64_t c = 0; c < s->components; c += together) {
            const int64_t read = read_components(rans, s, here, wide, c, c + together);
            if (read != ALL_READ) return read;
            if (s->predictors && s->step == 1) tell_component(s, c, here, wide);
        }
        for (int64_t i = 0; i < wide; i++) s->steps[here[i]] = s->step;
        if (s->predictors) add_pass(s, here, wide);
    }
    return ALL_READ;
}

/* Which anchors receive step `s->step`: 1 for each that does. */
WIDE static void mark_anchors(const Channel *s, const ChannelLayer *l, uint16_t *marks) {
    for (int64_t i = 0; i < s->count; i++) marks[i] = (l->before[i] < s->step) & (l->after[i] >= s->step);
}

/* The anchors that receive step `s->step`: in order, or by code. Returns how many. */
static int64_t choose_anchors(const Channel *s, const ChannelLayer *l, int64_t *out) {
    const int64_t *by_code = s->predictors ? l->by_code : NULL;
    const uint16_t *marks = s->kind;
    int64_t chosen = 0;
    mark_anchors(s, l, s->kind);
    if (by_code)
        for (int64_t i = 0; i < s->count; i++) out[chosen] = by_code[i], chosen += marks[by_code[i]];
    else
        for (int64_t i = 0; i < s->count; i++) out[chosen] = i, chosen += marks[i];
    return chosen;
}

/* Whether the anchors that receive step `s->step` are others than those that receive the one before. */
WIDE static int other_anchors(const Channel *s, const ChannelLayer *l) {
    const int64_t *before = l->before, *after = l->after, step = s->step;
    int64_t other = 0;
    for (int64_t i = 0; i < s->count; i++)
        other |= ((before[i] < step) & (after[i] >= step)) ^ ((before[i] < step - 1) & (after[i] >= step - 1));
    return other != 0;
}

/* Reads all steps of a layer; the rest as for channel_step. What is wrong is wrong in step `s->step`. */
int64_t scar_channel_layer(Rans *rans, Channel *s, const ChannelLayer *l) {
    int64_t chosen = 0;
    int by_code = 0;
    for (int64_t i = 0; i < s->count; i++) s->steps[i] = l->before[i];
    for (s->step = l->start; s->step < l->stop; s->step++) {
        const int64_t place = s->step - l->start;
        int64_t ends[MOST_PASSES], passes = 1;
        s->tables = l->tables ? l->tables[place] : NULL, s->predictors = l->predictors[place];
        const int64_t *anchors = l->chosen;
        if (s->step == l->start || by_code != (s->predictors != NULL) || other_anchors(s, l))
            chosen = choose_anchors(s, l, l->chosen);
        by_code = s->predictors != NULL;
        ends[0] = chosen;
        if (!chosen) continue;
        if (s->predictors) {
            passes = split_passes(l->chosen, chosen, l->passes_log2, l->anchors, ends);
            anchors = l->anchors;
        }
        const int64_t read = channel_step(rans, s, anchors, ends, passes);
        if (read != ALL_READ) return read;
    }
    return ALL_READ;
}
