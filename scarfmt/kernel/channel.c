/* Channel steps with static contexts and predictors (SPEC 7.5, 10.3): what scarfmt/codecs/channels.py and
scarfmt/neural/predictors.py define. */

#include "cells.h"
#include "steps.h"

#define AMAX 511
#define CLASS_INPUT 64.0f
#define MOST_COMPONENTS 64
#define TILE 64       /* anchors whose values stay in the cache while component after component is looked at */
#define BAD_TRIT (-2)
#define VALUE_RANGE (-3)

INLINE int64_t own_column(const Channel *s) { return CLASS_INPUTS + s->settled_columns; }

/* Inputs that all components share. */
INLINE int64_t shared_of(const Channel *s) {
    return own_column(s) + s->components + s->cells.depths * (s->components + 1);
}

INLINE int64_t width_of(const Channel *s) { return shared_of(s) + s->components * s->cells.depths; }

INLINE float clamped(double value) { return (float)(value < -AMAX ? -AMAX : value > AMAX ? AMAX : value); }

INLINE float coarse_input(double value) { return clamped(floor_of(value * (1.0 / 64))); }

/* This channel's fine values before the step, of a block. */
INLINE void own_values(const Channel *s, const int64_t *anchors, double own[][BLOCK]) {
    const double power = power_of(s->step - 1);
    for (int64_t c = 0; c < s->components; c++) {
        for (int j = 0; j < BLOCK; j++) own[c][j] = s->values[anchors[j] * s->components + c];
        for (int j = 0; j < BLOCK; j++) own[c][j] = s->step > 1 ? fine_of(own[c][j], power) : 0;
    }
}

/* Classes and settled channels of a block. */
INLINE void known_inputs(const Channel *s, const int64_t *anchors, float *x) {
    for (int64_t k = 0; k < CLASS_INPUTS * BLOCK; k++) x[k] = 0;
    for (int j = 0; j < BLOCK; j++) x[s->classes[anchors[j]] * BLOCK + j] = CLASS_INPUT;
    x += CLASS_INPUTS * BLOCK;
    for (int64_t k = 0; k < s->settled_columns; k++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++) {
            const int32_t value = s->settled[anchors[j] * s->settled_stride + k] >> 6;
            x[j] = (float)(value < -AMAX ? -AMAX : value > AMAX ? AMAX : value);
        }
}

/* The (width, BLOCK) inputs of a block of anchors (SPEC 10.3). */
INLINE void block_inputs(const Channel *s, const int64_t *anchors, float *x) {
    const int64_t components = s->components, depths = s->cells.depths;
    const double scale = power_of(s->step) / 32;
    double own[MOST_COMPONENTS][BLOCK], mean[MOST_COMPONENTS][BLOCK], count[BLOCK];
    known_inputs(s, anchors, x);
    own_values(s, anchors, own);
    x += own_column(s) * BLOCK;
    for (int64_t c = 0; c < components; c++, x += BLOCK) {
        for (int j = 0; j < BLOCK; j++) x[j] = coarse_input(own[c][j]);
        for (int j = 0; j < BLOCK; j++) mean[c][j] = 0;
    }
    float *counts = x + depths * components * BLOCK, *relative = counts + depths * BLOCK;
    for (int64_t d = 0; d < depths; d++) {
        block_means(&s->cells, d, anchors, &mean[0][0], count);
        for (int j = 0; j < BLOCK; j++) counts[d * BLOCK + j] = (float)count_feature(count[j]);
        for (int64_t c = 0; c < components; c++) {
            float *restrict coarse = x + (d * components + c) * BLOCK;
            float *restrict apart = relative + (c * depths + d) * BLOCK;
            for (int j = 0; j < BLOCK; j++) coarse[j] = coarse_input(mean[c][j]);
            for (int j = 0; j < BLOCK; j++) apart[j] = clamped(floor_of((mean[c][j] - own[c][j]) * scale + 0.5));
        }
    }
}

/* Context numbers of a component's symbols in a block, of its `x` and the component's own inputs. */
INLINE void block_contexts(const Predictor *p, int64_t shared, int64_t depths, const float *x, const float *own,
                           int32_t *context) {
    const int64_t width = shared + depths;
    Lanes sums[2] = {{0}, {0}};
    for (int64_t row = 0; row < p->rows; row += ROWS) {
        Lanes out[ROWS] = {{0}, {0}, {0}, {0}, {0}};
        add_products(p->weights + row * width, width, x, shared, out);
        add_products(p->weights + row * width + shared, width, own, depths, out);
        for (int64_t r = 0; r < ROWS; r++) {
            const int64_t unit = row + r;
            if (unit >= p->units) {
                if (unit < p->units + 2) sums[unit - p->units] += out[r];
                continue;
            }
            Lanes hidden = out[r] + p->biases[unit];
            clamp_lanes(&hidden, 0, AMAX);
            floor_lanes(&hidden);
            sums[0] += p->output[unit] * hidden;
            sums[1] += p->output[p->units + unit] * hidden;
        }
    }
    IntLanes bucket[2];
    for (int k = 0; k < 2; k++) {
        sums[k] += p->output_biases[k];
        clamp_lanes(sums + k, 0, p->last[k]);
        bucket[k] = __builtin_convertvector(sums[k], IntLanes);
    }
    *(IntLanes *)context = bucket[0] * (int32_t)(p->last[1] + 1) + bucket[1];
}

/* Inputs of all blocks of a pass. */
WIDE static void pass_inputs(const Channel *s, const int64_t *anchors, int64_t wide) {
    int64_t block[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        block_anchors(anchors, wide, i, block);
        block_inputs(s, block, s->inputs + i * width_of(s));
    }
}

/* Context numbers of components first..past - 1 that have a predictor; in step 1 of the inputs of the whole pass, else
block by block. */
WIDE static void predict(const Channel *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    const int64_t shared = shared_of(s), depths = s->cells.depths;
    int64_t block[BLOCK];
    int32_t context[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        float *x = s->inputs;
        if (s->step == 1) {
            x += i * width_of(s);
        } else {
            block_anchors(anchors, wide, i, block);
            block_inputs(s, block, x);
        }
        const int64_t here = wide - i < BLOCK ? wide - i : BLOCK;
        for (int64_t c = first; c < past; c++) {
            if (!s->predictors[c].rows) continue;
            block_contexts(s->predictors + c, shared, depths, x, x + (shared + c * depths) * BLOCK, context);
            uint16_t *kind = s->kind + (c - first) * wide + i;
            for (int64_t j = 0; j < here; j++) kind[j] = (uint16_t)(context[j] + (c - first) * KINDS);
        }
    }
}

/* Context numbers of a component from anchor `from` to `to` of a pass without a predictor (SPEC 8.4). */
static void follow_rule(const Channel *s, int64_t component, const int64_t *anchors, int64_t from, int64_t to,
                        int64_t base, uint16_t *kind) {
    const Rule *rule = s->rules + component;
    const int32_t *source = rule->source < 0 ? NULL : s->sources[rule->source] + rule->component;
    for (int64_t i = from; i < to; i++) {
        int64_t number = base;
        if (s->step > 1) {
            const int32_t value = s->values[anchors[i] * s->components + component];
            number += (value < -2 ? -2 : value > 2 ? 2 : value) + 2;
        } else if (source) {
            const int64_t bucket = (source[anchors[i] * rule->columns] - rule->low) >> rule->shift;
            number += bucket < 0 ? 0 : bucket >= CLASS_KINDS ? CLASS_KINDS - 1 : bucket;
        }
        if (rule->by_class) number += s->classes[anchors[i]] * CLASS_KINDS;
        kind[i] = (uint16_t)number;
    }
}

/* Kinds of the symbols of components first..past - 1 of a pass. */
static void put_kinds(const Channel *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    if (s->predictors) predict(s, anchors, wide, first, past);
    for (int64_t from = 0; from < wide; from += TILE) {
        const int64_t to = from + TILE < wide ? from + TILE : wide;
        for (int64_t c = first; c < past; c++)
            if (!s->predictors || !s->predictors[c].rows)
                follow_rule(s, c, anchors, from, to, (c - first) * KINDS, s->kind + (c - first) * wide);
    }
}

/* Symbols of components first..past - 1 of a pass, from values that are known; whether all are such as can be read. */
static int given_symbols(const Channel *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    for (int64_t c = first; c < past; c++)
        for (int64_t i = 0; i < wide; i++) {
            const int64_t at = anchors[i] * s->components + c;
            const int64_t before = s->step > 1 ? 3 * (int64_t)s->values[at] : 0;
            const int64_t symbol = s->given[at] - before;
            if (s->step > 1 && (symbol < -1 || symbol > 1)) return 0;
            s->symbols_out[(c - first) * wide + i] = (int32_t)symbol;
        }
    return 1;
}

/* Symbols of components first..past - 1 of a pass, n together, from a stream: ALL_READ or a kind without a table. */
static int64_t read_symbols(Rans *rans, const Channel *s, int64_t n, int64_t first, int64_t past) {
    /* Kinds of these components alone: clearing and walking those of all would take longer than reading few. */
    Tables tables = *s->tables;
    tables.kinds = (past - first) * KINDS;
    tables.number += first * KINDS;
    tables.used += first * KINDS;
    const int64_t read = scar_rans_grouped(rans, &tables, s->kind, n, s->counts, s->order, s->symbols);
    return read == ALL_READ ? read : read + first * KINDS;
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
                if (s->step == 1) s->first[at] = (int32_t)now;
            }
    }
    return !outside;
}

/* Reads or writes components first..past - 1 of a pass; ALL_READ or what is wrong. */
static int64_t code_components(Rans *rans, Channel *s, const int64_t *anchors, int64_t wide, int64_t first,
                               int64_t past) {
    const int64_t n = (past - first) * wide;
    const int32_t *symbols = s->symbols;
    put_kinds(s, anchors, wide, first, past);
    if (s->given) {
        if (!given_symbols(s, anchors, wide, first, past)) return BAD_TRIT;
        for (int64_t i = 0; i < n; i++) s->kinds_out[i] = (uint16_t)(s->kind[i] + first * KINDS);
        symbols = s->symbols_out;
        s->kinds_out += n, s->symbols_out += n;
    } else {
        const int64_t read = read_symbols(rans, s, n, first, past);
        if (read != ALL_READ) return read;
    }
    if (s->step > 1 && !all_trits(symbols, n)) return BAD_TRIT;
    return put_values(s, symbols, anchors, wide, first, past) ? ALL_READ : VALUE_RANGE;
}

/* In step 1, what was just read is an input of the components after it. */
WIDE static void tell_component(const Channel *s, int64_t component, const int64_t *anchors, int64_t wide) {
    const int64_t size = width_of(s), column = own_column(s) + component;
    int64_t block[BLOCK];
    double value[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        float *restrict x = s->inputs + i * size + column * BLOCK;
        block_anchors(anchors, wide, i, block);
        for (int j = 0; j < BLOCK; j++) value[j] = s->values[block[j] * s->components + component];
        for (int j = 0; j < BLOCK; j++) x[j] = coarse_input(fine_of(value[j], 1));
    }
}

/* Adds a block of anchors, the first `some` of its lanes, to the cells. */
INLINE void add_block(const Channel *s, const int64_t *anchors, int64_t some) {
    double numbers[MOST_COMPONENTS][BLOCK], power[BLOCK];
    for (int j = 0; j < BLOCK; j++) power[j] = power_of(s->steps[anchors[j]]);
    for (int64_t c = 0; c < s->components; c++) {
        for (int j = 0; j < BLOCK; j++) numbers[c][j] = s->values[anchors[j] * s->components + c];
        for (int j = 0; j < BLOCK; j++) numbers[c][j] = fine_of(numbers[c][j], power[j]);
    }
    for (int64_t j = 0; j < some; j++) add_to_cells(&s->cells, anchors[j], &numbers[0][j], BLOCK);
}

/* Adds the anchors of a pass, all of which have a step. */
WIDE static void add_pass(const Channel *s, const int64_t *anchors, int64_t wide) {
    int64_t block[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        block_anchors(anchors, wide, i, block);
        add_block(s, block, wide - i < BLOCK ? wide - i : BLOCK);
    }
}

/* The cells with the anchors that have the step already. */
WIDE static void fill_cells(const Channel *s) {
    int64_t block[BLOCK], some = 0;
    empty_cells(&s->cells);
    for (int64_t anchor = 0; anchor < s->count; anchor++) {
        if (s->steps[anchor] < s->step) continue;
        block[some++] = anchor;
        if (some == BLOCK) add_block(s, block, some), some = 0;
    }
    for (int64_t j = some; some && j < BLOCK; j++) block[j] = block[0];
    if (some) add_block(s, block, some);
}

/* Reads or writes the step of a channel that `s` names, pass by pass (SPEC 7.5, 10.3); `ends`: where each pass ends
among the anchors.

Returns ALL_READ, BAD_TRIT, VALUE_RANGE, or a kind (component * 256 + context) without a table. */
EXPORT int64_t scar_channel_step(Rans *rans, Channel *s, const int64_t *anchors, const int64_t *ends, int64_t passes) {
    if (s->predictors) fill_cells(s);
    for (int64_t pass = 0, start = 0; pass < passes; start = ends[pass++]) {
        const int64_t *here = anchors + start;
        const int64_t wide = ends[pass] - start;
        if (!wide) continue;
        if (s->predictors && s->step == 1) pass_inputs(s, here, wide);
        /* The components of a first step are context for each other; later steps need no component's news. */
        const int64_t together = s->step == 1 ? 1 : s->components;
        for (int64_t c = 0; c < s->components; c += together) {
            const int64_t read = code_components(rans, s, here, wide, c, c + together);
            if (read != ALL_READ) return read;
            if (s->predictors && s->step == 1) tell_component(s, c, here, wide);
        }
        for (int64_t i = 0; i < wide; i++) s->steps[here[i]] = s->step;
        if (s->predictors) add_pass(s, here, wide);
    }
    return ALL_READ;
}

/* The anchors that receive step `s->step`: in order, or by code. Returns how many. */
static int64_t choose_anchors(const Channel *s, const ChannelLayer *l, int64_t *out) {
    const int64_t *by_code = s->predictors ? l->by_code : NULL;
    int64_t chosen = 0;
    for (int64_t i = 0; i < s->count; i++) {
        const int64_t anchor = by_code ? by_code[i] : i;
        out[chosen] = anchor;
        chosen += l->before[anchor] < s->step && l->after[anchor] >= s->step;
    }
    return chosen;
}

/* Reads all steps of a layer; the rest as for scar_channel_step. What is wrong is wrong in step `s->step`. */
EXPORT int64_t scar_channel_layer(Rans *rans, Channel *s, const ChannelLayer *l) {
    for (int64_t i = 0; i < s->count; i++) s->steps[i] = l->before[i];
    for (s->step = l->start; s->step < l->stop; s->step++) {
        const int64_t place = s->step - l->start;
        int64_t ends[MOST_PASSES], passes = 1;
        s->tables = l->tables[place], s->predictors = l->predictors[place];
        const int64_t *anchors = l->chosen;
        const int64_t chosen = ends[0] = choose_anchors(s, l, l->chosen);
        if (!chosen) continue;
        if (s->predictors) {
            passes = split_passes(l->chosen, chosen, l->passes_log2, l->anchors, ends);
            anchors = l->anchors;
        }
        l->read[place] = chosen;
        const int64_t read = scar_channel_step(rans, s, anchors, ends, passes);
        if (read != ALL_READ) return read;
    }
    return ALL_READ;
}
