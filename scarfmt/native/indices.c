/* Indices by the index network (SPEC 10.5): what scarfmt/codecs/neural_indices.py and scarfmt/neural/evaluator.py define,
without attention. A pass is worked on in blocks of anchors, all their numbers of one kind side by side. */

#include "cells.h"
#include "products.h"
#include "rans.h"

#define CLASS_VALUE 64
#define GATES 3
#define RECURRENT_AMAX 2047
#define ONE 4096          /* of gates */
#define TABLE_END 255     /* tables of sigmoid and tanh: -TABLE_END..TABLE_END */
#define BAD_INDEX (-2)

INLINE int64_t even(int64_t rows) { return rows + rows % 2; }

/* (rows, BLOCK) numbers as (rows / 2 rounded up, BLOCK) words. */
INLINE void put_words(const int32_t *x, int64_t rows, int32_t *out) {
    static const int32_t none[BLOCK] = {0};
    for (int64_t r = 0; r < rows; r += 2, x += 2 * BLOCK, out += BLOCK) put_pairs(x, r + 1 < rows ? x + BLOCK : none, out);
}

/* The inputs of a block, in words. */
INLINE void network_inputs(const Network *net, const Indices *s, const int64_t *anchors, int32_t *out) {
    const int32_t amax = (int32_t)net->amax, shift = (int32_t)net->latent_shift, half = 1 << shift >> 1;
    int32_t *x = s->inputs, (*mean)[BLOCK] = (int32_t(*)[BLOCK])s->means;
    for (int64_t c = 0; c < net->classes; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++) x[j] = c == s->classes[anchors[j]] ? limited(CLASS_VALUE, -amax, amax) : 0;
    for (int64_t c = 0; net->own && c < net->attributes; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++)
            x[j] = limited(s->settled[anchors[j] * net->attributes + c] >> 6, -amax, amax);
    memset(mean, 0, (size_t)s->cells.columns * sizeof mean[0]);
    for (int64_t d = 0; d < s->cells.depths; d++) {
        mean_columns(&s->cells, d, anchors, mean);
        for (int64_t c = 0; c < net->attributes; c++, x += BLOCK)
            for (int j = 0; j < BLOCK; j++) x[j] = limited(mean[c][j] >> 6, -amax, amax);
        for (int64_t c = net->attributes; c < s->cells.columns; c++, x += BLOCK)
            for (int j = 0; j < BLOCK; j++) x[j] = limited((mean[c][j] + half) >> shift, -amax, amax);
        for (int j = 0; j < BLOCK; j++) x[j] = limited(mean[s->cells.columns][j], -amax, amax);
        x += BLOCK;
    }
    for (int64_t c = 0; c < net->grid; c++, x += BLOCK)
        for (int j = 0; j < BLOCK; j++) x[j] = limited(s->features[anchors[j] * net->grid + c], -amax, amax);
    put_words(s->inputs, (x - s->inputs) / BLOCK, out);
}

/* What the embeddings of a pass add to the mixer. */
WIDE static void embed(const Network *net, const Indices *s, const int64_t *anchors, int64_t wide) {
    const Products *products = products_at_hand();
    int64_t block[BLOCK];
    int32_t *x = s->lanes, *first = x + net->embed[0].words * BLOCK, *h = first + net->embed[1].words * BLOCK;
    fill_means(&s->cells);
    for (int64_t i = 0; i < wide; i += BLOCK) {
        block_anchors(anchors, wide, i, block);
        network_inputs(net, s, block, x);
        products->pairs(net->embed, x, first);
        products->pairs(net->embed + 1, first, h);
        products->rows(&net->mix_embedding, h, s->shares + i * net->mix_embedding.rows);
    }
}

/* table[x], the ends of the table beyond it. */
INLINE void look_up(const int32_t *table, int32_t *x) {
    for (int j = 0; j < BLOCK; j++) x[j] = limited(x[j], -TABLE_END, TABLE_END) + TABLE_END;
    for (int j = 0; j < BLOCK; j++) x[j] = table[x[j]];
}

/* Products of the input of the first recurrent layer: those of a codeword, for the token of `stage`. */
INLINE void token_products(const Network *net, int64_t stage, const int64_t *codes, int32_t *out) {
    const int64_t rows = GATES * net->hidden;
    const int32_t *table = net->gru[0].tokens[stage > 1], *biases = net->gru[0].biases + (stage - 1) * rows;
    for (int64_t r = 0; r < rows; r++, out += BLOCK)
        for (int j = 0; j < BLOCK; j++) out[j] = table[codes[j] * rows + r] + biases[r];
}

/* The new state of a recurrent layer, in place; `input` are its products with the input and their biases. */
INLINE void step_layer(const Network *net, const Products *products, const Recurrence *layer, const int32_t *input,
                       int32_t *state, int32_t *words, int32_t *own) {
    const int64_t width = net->hidden * BLOCK;
    const int32_t shift = (int32_t)layer->shift, half = 1 << shift >> 1;
    put_words(state, net->hidden, words);
    products->rows(&layer->recurrent, words, own);
    for (int64_t u = 0; u < width; u += BLOCK, state += BLOCK) {
        int32_t z[BLOCK], r[BLOCK], n[BLOCK];
        for (int j = 0; j < BLOCK; j++) z[j] = (input[u + j] + own[u + j]) >> shift;
        for (int j = 0; j < BLOCK; j++) r[j] = (input[width + u + j] + own[width + u + j]) >> shift;
        look_up(net->sigmoid, z);
        look_up(net->sigmoid, r);
        for (int j = 0; j < BLOCK; j++) {
            const int32_t kept = limited((own[2 * width + u + j] + half) >> shift, -RECURRENT_AMAX, RECURRENT_AMAX);
            n[j] = (input[2 * width + u + j] >> shift) + ((r[j] * kept + ONE / 2) >> 12);
        }
        look_up(net->tanh, n);
        for (int j = 0; j < BLOCK; j++) state[j] = (z[j] * state[j] + (ONE - z[j]) * n[j] + ONE / 2) >> 12;
    }
}

/* The (layers, H) states of a block after the token of `stage`, in place. */
INLINE void step_block(const Network *net, const Indices *s, int64_t stage, const int64_t *codes, int32_t *states) {
    const Products *products = products_at_hand();
    const int64_t width = net->hidden, rows = even(GATES * width);
    int32_t *input = s->lanes, *own = input + rows * BLOCK, *words = own + rows * BLOCK;
    token_products(net, stage, codes, input);
    for (int64_t l = 0; l < net->layers; l++) {
        if (l) {
            put_words(states + (l - 1) * width * BLOCK, width, words);
            products->rows(&net->gru[l].inputs, words, input);
        }
        step_layer(net, products, net->gru + l, input, states + l * width * BLOCK, words, own);
    }
}

/* Indices of `stage` of a block; 0 where an anchor has none: its state no longer matters. */
INLINE void block_codes(const Indices *s, int64_t stage, const int64_t *anchors, int64_t *codes) {
    for (int j = 0; j < BLOCK; j++)
        codes[j] = s->after[anchors[j]] >= stage ? s->indices[anchors[j] * s->stages + stage - 1] : 0;
}

/* `layers` states from layer `first` on of a block after the first token, from the table. */
INLINE void first_states(const Network *net, const int64_t *codes, int64_t first, int64_t layers, int32_t *states) {
    const int64_t size = net->layers * net->hidden;
    const int32_t *table = net->after_first + first * net->hidden;
    for (int64_t r = 0; r < layers * net->hidden; r++, states += BLOCK)
        for (int j = 0; j < BLOCK; j++) states[j] = table[codes[j] * size + r];
}

/* States of a pass after the indices of `stage`, 2 or more. */
WIDE static void advance_pass(const Network *net, const Indices *s, const int64_t *anchors, int64_t wide,
                              int64_t stage) {
    int64_t block[BLOCK], codes[BLOCK];
    for (int64_t i = 0; i < wide; i += BLOCK) {
        int32_t *states = s->states + i * net->layers * net->hidden;
        block_anchors(anchors, wide, i, block);
        if (stage == 2) {
            block_codes(s, 1, block, codes);
            first_states(net, codes, 0, net->layers, states);
        }
        block_codes(s, stage, block, codes);
        step_block(net, s, stage, codes, states);
    }
}

/* The context y of `stage` of the block of anchors that begins at `place` of its pass, in words; `sums`: scratch of as
many rows as the mixer has, and as many as a state and its words. */
INLINE void mix(const Network *net, const Indices *s, int64_t stage, const int64_t *anchors, int64_t place, int32_t *y,
                int32_t *sums) {
    const int64_t mixed = net->mix_state.rows, shift = net->mix_shift;
    const int32_t *share = s->shares + place * mixed, amax = (int32_t)net->amax;
    int64_t codes[BLOCK];
    if (stage > 1) {
        const int32_t *state = s->states + (place * net->layers + (net->layers - 1) * BLOCK) * net->hidden;
        int32_t *first = sums + mixed * BLOCK, *words = first + net->hidden * BLOCK;
        if (stage == 2) {
            block_codes(s, 1, anchors, codes);
            first_states(net, codes, net->layers - 1, 1, first);
            state = first;
        }
        put_words(state, net->hidden, words);
        products_at_hand()->rows(&net->mix_state, words, sums);
    }
    for (int64_t r = 0; r < mixed; r++)
        for (int j = 0; j < BLOCK; j++) {
            const int32_t own = stage > 1 ? sums[r * BLOCK + j] : net->mix_start[r];
            sums[r * BLOCK + j] = limited((own + share[r * BLOCK + j]) >> shift, 0, amax);
        }
    put_words(sums, mixed, y);
}

/* Reads the indices of a stage. */
WIDE static void read_stage(Rans *rans, const Network *net, Indices *s, int64_t stage, const int64_t *anchors,
                            int64_t wide) {
    const Products *products = products_at_hand();
    const Head *head = net->heads + (stage > 1);
    const int64_t size = head->size;
    uint32_t *totals = s->weights + size * BLOCK;
    int64_t block[BLOCK];
    Rans local = *rans;
    int32_t *y = s->lanes, *o = y + head->project.words * BLOCK, *logits = o + head->top.words * BLOCK;
    for (int64_t i = 0; i < wide; i += BLOCK) {
        int64_t coded[BLOCK], count = 0;
        block_anchors(anchors, wide, i, block);
        for (int64_t j = 0; j < BLOCK && i + j < wide; j++)
            if (s->before[block[j]] < stage && s->after[block[j]] >= stage) coded[count++] = j;
        if (!count) continue;
        mix(net, s, stage, block, i, y, o);
        products->pairs(&head->project, y, o);
        products->rows(&head->top, o, logits);
        column_weights(logits, size, net->exp2, s->weights, totals);
        for (int64_t k = 0; k < count; k++) {
            const int64_t j = coded[k];
            s->indices[block[j] * s->stages + stage - 1] =
                size > 1 ? (int16_t)weighted(&local, s->weights + j, BLOCK, totals[j], (uint32_t)size) : 0;
        }
    }
    *rans = local;
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
int64_t scar_indices(Rans *rans, const Network *net, Indices *s) {
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
