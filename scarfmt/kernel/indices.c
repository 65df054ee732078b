/* Indices by the index network (SPEC 10.5): what scarfmt/codecs/neural_indices.py and scarfmt/neural/evaluator.py define,
without attention. A pass is worked on in blocks of anchors, all their numbers of one kind side by side. */

#include "cells.h"
#include "rans.h"

#define CLASS_VALUE 64.0f
#define GATES 3
#define RECURRENT_AMAX 2047
#define TABLE_END 255     /* tables of sigmoid and tanh: -TABLE_END..TABLE_END */
#define BAD_INDEX (-2)

INLINE void products(const float *weights, int64_t inputs, int64_t outputs, const Lanes *x, Lanes *out) {
    for (int64_t row = 0; row < outputs; row += ROWS) {
        Lanes sums[ROWS] = {{0}, {0}, {0}, {0}, {0}};
        add_products(weights + row * inputs, inputs, (const float *)x, inputs, sums);
        for (int64_t r = 0; r < ROWS; r++) out[row + r] = sums[r];
    }
}

/* `out` has room for the rows that fill up. */
INLINE void linear(const Linear *l, const Lanes *x, Lanes *out) {
    products(l->weights, l->inputs, l->outputs, x, out);
    for (int64_t r = 0; r < l->outputs; r++) {
        out[r] += l->biases[r];
        clamp_lanes(out + r, l->low, l->high);
        floor_lanes(out + r);
    }
}

INLINE float within(double value, double amax) {
    return (float)(value < -amax ? -amax : value > amax ? amax : value);
}

/* The inputs of a block. */
INLINE void network_inputs(const Network *net, const Indices *s, const int64_t *anchors, float *x) {
    const double amax = (double)net->amax, scale = 1.0 / (double)((int64_t)1 << net->latent_shift);
    const double half = net->latent_shift ? 0.5 : 0;
    double count[BLOCK], *mean = s->means;
    for (int64_t c = 0; c < net->classes; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++) x[j] = c == s->classes[anchors[j]] ? within(CLASS_VALUE, amax) : 0;
    for (int64_t c = 0; net->own && c < net->attributes; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++)
            x[j] = within((double)(s->settled[anchors[j] * net->attributes + c] >> 6), amax);
    for (int64_t k = 0; k < s->cells.columns * BLOCK; k++) mean[k] = 0;
    for (int64_t d = 0; d < s->cells.depths; d++) {
        block_means(&s->cells, d, anchors, mean, count);
        for (int64_t k = 0; k < net->attributes * BLOCK; k++) *x++ = within(floor_of(mean[k] * (1.0 / 64)), amax);
        for (int64_t k = net->attributes * BLOCK; k < s->cells.columns * BLOCK; k++)
            *x++ = within(floor_of(mean[k] * scale + half), amax);
        for (int j = 0; j < BLOCK; j++) *x++ = within(count_feature(count[j]), amax);
    }
    for (int64_t c = 0; c < net->grid; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++) x[j] = within(s->features[anchors[j] * net->grid + c], amax);
}

/* What the embeddings of a pass add to the mixer. */
WIDE static void embed(const Network *net, const Indices *s, const int64_t *anchors, int64_t wide) {
    int64_t block[BLOCK];
    Lanes *x = s->lanes, *first = x + net->embed[0].inputs, *h = first + filled(net->embed[0].outputs);
    Lanes *share = h + filled(net->hidden);
    for (int64_t i = 0; i < wide; i += BLOCK) {
        block_anchors(anchors, wide, i, block);
        network_inputs(net, s, block, (float *)x);
        linear(net->embed, x, first);
        linear(net->embed + 1, first, h);
        products(net->mix_embedding.weights, net->hidden, net->mixed, h, share);
        for (int64_t r = 0; r < net->mixed; r++)
            s->shares[i / BLOCK * net->mixed + r] = share[r] + net->mix_embedding.biases[r];
    }
}

/* table[x] of integers x, the ends of the table beyond it. */
INLINE void look_up(const float *table, Lanes *x) {
    clamp_lanes(x, -TABLE_END, TABLE_END);
    floor_lanes(x);
    const IntLanes place = __builtin_convertvector(*x, IntLanes) + TABLE_END;
    float out[BLOCK];
    for (int j = 0; j < BLOCK; j++) out[j] = table[place[j]];
    *x = *(const Lanes *)out;
}

/* Products of the input of the first recurrent layer: those of a codeword, for the token of `stage`. */
INLINE void token_products(const Network *net, int64_t stage, const int64_t *codes, Lanes *out) {
    const int64_t rows = GATES * net->hidden;
    const float *table = net->gru[0].tokens[stage > 1], *biases = net->gru[0].biases + (stage - 1) * rows;
    for (int64_t r = 0; r < rows; r++) {
        float here[BLOCK];
        for (int j = 0; j < BLOCK; j++) here[j] = table[codes[j] * rows + r] + biases[r];
        out[r] = *(const Lanes *)here;
    }
}

/* The new state of a recurrent layer, in place; `input` are its products with the input and their biases. */
INLINE void step_layer(const Network *net, const Recurrence *layer, Lanes *input, Lanes *state, Lanes *own) {
    const int64_t width = net->hidden;
    products(layer->recurrent, width, GATES * width, state, own);
    for (int64_t u = 0; u < width; u++) {
        Lanes z = input[u] + own[u] + layer->offsets[u];
        Lanes r = input[width + u] + own[width + u] + layer->offsets[width + u];
        Lanes kept = own[2 * width + u] + layer->offsets[2 * width + u], candidate = input[2 * width + u];
        look_up(net->sigmoid, &z);
        look_up(net->sigmoid, &r);
        clamp_lanes(&kept, -RECURRENT_AMAX, RECURRENT_AMAX);
        floor_lanes(&kept);
        floor_lanes(&candidate);
        kept = kept * r + candidate + 0.5f;
        look_up(net->tanh, &kept);
        state[u] = (state[u] - kept) * z + kept + 0.5f;
        floor_lanes(state + u);
    }
}

/* The (layers, H) states of a block after the token of `stage`, in place. */
INLINE void step_block(const Network *net, const Indices *s, int64_t stage, const int64_t *codes, Lanes *states) {
    const int64_t width = net->hidden, rows = filled(GATES * width);
    Lanes *input = s->lanes, *own = input + rows;
    token_products(net, stage, codes, input);
    for (int64_t l = 0; l < net->layers; l++) {
        if (l) {
            products(net->gru[l].inputs, width, GATES * width, states + (l - 1) * width, input);
            for (int64_t r = 0; r < GATES * width; r++) input[r] += net->gru[l].biases[r];
        }
        step_layer(net, net->gru + l, input, states + l * width, own);
    }
}

/* Indices of `stage` of a block; 0 where an anchor has none: its state no longer matters. */
INLINE void block_codes(const Indices *s, int64_t stage, const int64_t *anchors, int64_t *codes) {
    for (int j = 0; j < BLOCK; j++)
        codes[j] = s->after[anchors[j]] >= stage ? s->indices[anchors[j] * s->stages + stage - 1] : 0;
}

/* `layers` states from layer `first` on of a block after the first token, from the table. */
INLINE void first_states(const Network *net, const int64_t *codes, int64_t first, int64_t layers, Lanes *states) {
    const int64_t size = net->layers * net->hidden;
    for (int64_t r = 0; r < layers * net->hidden; r++) {
        float here[BLOCK];
        for (int j = 0; j < BLOCK; j++) here[j] = net->after_first[codes[j] * size + first * net->hidden + r];
        states[r] = *(const Lanes *)here;
    }
}

/* States of a pass after the indices of `stage`, 2 or more. */
WIDE static void advance_pass(const Network *net, const Indices *s, const int64_t *anchors, int64_t wide,
                              int64_t stage) {
    int64_t block[BLOCK], codes[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        Lanes *states = s->states + i / BLOCK * net->layers * net->hidden;
        block_anchors(anchors, wide, i, block);
        if (stage == 2) {
            block_codes(s, 1, block, codes);
            first_states(net, codes, 0, net->layers, states);
        }
        block_codes(s, stage, block, codes);
        step_block(net, s, stage, codes, states);
    }
}

/* The context y of `stage` of a block, of `mixed` rows. */
INLINE void mix(const Network *net, const Indices *s, int64_t stage, const int64_t *anchors, int64_t place, Lanes *y) {
    const Lanes *share = s->shares + place * net->mixed;
    int64_t codes[BLOCK];
    if (stage > 1) {
        const Lanes *state = s->states + ((place + 1) * net->layers - 1) * net->hidden;
        Lanes *first = y + filled(net->mixed);
        if (stage == 2) {
            block_codes(s, 1, anchors, codes);
            first_states(net, codes, net->layers - 1, 1, first);
            state = first;
        }
        products(net->mix_state.weights, net->hidden, net->mixed, state, y);
    }
    const Lanes none = {0};
    for (int64_t r = 0; r < net->mixed; r++) {
        if (stage == 1) y[r] = none + net->mix_start[r];
        y[r] += share[r];
        clamp_lanes(y + r, 0, (float)net->amax);
        floor_lanes(y + r);
    }
}

/* Reads the first symbols of a stage: indices of a flat head, clusters of a two-level one, and for those what the
second projection gives. Returns how many anchors are coded. */
WIDE static int64_t read_first(Rans *rans, const Network *net, Indices *s, int64_t stage, const int64_t *anchors,
                               int64_t wide) {
    const Head *head = net->heads + (stage > 1);
    const int64_t width = head->first.outputs, size = head->top.outputs;
    uint32_t *totals = s->weights + size * BLOCK;
    int64_t block[BLOCK], coded = 0;
    Rans local = *rans;
    Lanes *y = s->lanes, *o = y + filled(net->mixed) + filled(net->hidden), *logits = o + filled(width);
    for (int64_t i = 0; i < wide; i += BLOCK) {
        const int64_t start = coded;
        block_anchors(anchors, wide, i, block);
        for (int64_t j = 0; j < BLOCK && i + j < wide; j++)
            if (s->before[block[j]] < stage && s->after[block[j]] >= stage) s->coded[coded++] = i + j;
        if (coded == start) continue;
        mix(net, s, stage, block, i / BLOCK, y);
        linear(&head->first, y, o);
        linear(&head->top, o, logits);
        column_weights((const float *)logits, size, BLOCK, net->exp2, s->weights, totals);
        for (int64_t k = start; k < coded; k++) {
            const int64_t j = s->coded[k] - i;
            s->clusters[k] = size > 1 ? weighted(&local, s->weights + j, BLOCK, totals[j], (uint32_t)size) : 0;
        }
        if (!head->members) continue;
        linear(&head->second, y, o);
        for (int64_t k = start; k < coded; k++)
            for (int64_t r = 0; r < width; r++)
                s->outputs[k * width + r] = ((const float *)(o + r))[s->coded[k] - i];
    }
    *rans = local;
    s->modelled += coded;
    return coded;
}

/* Reads the indices of a stage. */
static void read_stage(Rans *rans, const Network *net, Indices *s, int64_t stage, const int64_t *anchors,
                       int64_t wide) {
    const Members *members = net->heads[stage > 1].members;
    const int64_t coded = read_first(rans, net, s, stage, anchors, wide);
    if (members && coded)
        scar_rans_members(rans, members, s->clusters, s->outputs, coded, net->exp2, s->counts, s->order, s->logits,
                          s->member_weights, s->found);
    for (int64_t k = 0; k < coded; k++) {
        int64_t index = s->clusters[k];
        if (members) {
            const int64_t start = members->starts[index];
            s->modelled += members->starts[index + 1] - start > 1;
            index = start + s->found[k];
        }
        s->indices[anchors[s->coded[k]] * s->stages + stage - 1] = (int16_t)index;
    }
}

/* Adds m anchors, each with the sum of its codewords of the first stages, to the cells. */
WIDE static void add_anchors(const Network *net, const Indices *s, const int64_t *anchors, int64_t m,
                             const int64_t *stages) {
    double numbers[MOST_CONTEXT_COLUMNS], *latents = numbers + net->attributes;
    for (int64_t i = 0; i < m; i++) {
        const int64_t anchor = anchors[i];
        for (int64_t c = 0; c < net->attributes; c++) numbers[c] = s->settled[anchor * net->attributes + c];
        for (int64_t c = 0; c < net->latents; c++) latents[c] = 0;
        for (int64_t stage = 0; stage < stages[anchor]; stage++) {
            const float *word = net->books[stage > 0] + s->indices[anchor * s->stages + stage] * net->latents;
            for (int64_t c = 0; c < net->latents; c++) latents[c] += word[c];
        }
        add_to_cells(&s->cells, anchor, numbers, 1);
    }
}

static void read_pass(Rans *rans, const Network *net, Indices *s, const int64_t *anchors, int64_t wide) {
    int64_t last = 0;
    for (int64_t i = 0; i < wide; i++) last = s->after[anchors[i]] > last ? s->after[anchors[i]] : last;
    embed(net, s, anchors, wide);
    for (int64_t stage = 1; stage <= last; stage++) {
        read_stage(rans, net, s, stage, anchors, wide);
        if (stage > 1 && stage < last) advance_pass(net, s, anchors, wide, stage);
    }
    add_anchors(net, s, anchors, wide, s->after);
}

/* Whether indices known before are those of codewords. */
static int known_indices(const Network *net, const Indices *s) {
    for (int64_t i = 0; i < s->count; i++)
        for (int64_t stage = 0; stage < s->before[i]; stage++) {
            const int64_t index = s->indices[i * s->stages + stage];
            if (index < 0 || index >= net->sizes[stage > 0]) return 0;
        }
    return 1;
}

/* Reads the indices of a tile-layer: ALL_READ, or BAD_INDEX where one that is known is none. */
EXPORT int64_t scar_indices(Rans *rans, const Network *net, Indices *s) {
    int64_t chosen = 0, known = 0, ends[MOST_PASSES];
    if (!known_indices(net, s)) return BAD_INDEX;
    empty_cells(&s->cells);
    for (int64_t i = 0; i < s->count; i++) {
        s->chosen[known] = i;
        known += s->before[i] > 0;
    }
    add_anchors(net, s, s->chosen, known, s->before);
    for (int64_t i = 0; i < s->count; i++) {
        s->chosen[chosen] = s->by_code[i];
        chosen += s->before[s->by_code[i]] < s->after[s->by_code[i]];
    }
    const int64_t passes = split_passes(s->chosen, chosen, s->passes_log2, s->anchors, ends);
    for (int64_t pass = 0, start = 0; pass < passes; start = ends[pass++])
        if (ends[pass] > start) read_pass(rans, net, s, s->anchors + start, ends[pass] - start);
    return ALL_READ;
}
