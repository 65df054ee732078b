/* The index network as the kernel reads it, and its recurrent layers one anchor at a time (SPEC 10.1, 10.5). */

#include <string.h>

#include "integer_tables.h"
#include "lanes.h"
#include "network.h"

#define BAD "bad-network"
#define ONE 4096
#define STATE_BITS 12
#define RECURRENT_AMAX 2047

static void fill_tables(Pool *pool, int64_t activation_bits, Network *out) {
    int32_t *sigmoids = pool_take(pool, 4 * (2 * TABLE_END + 1)), *states_of = pool_take(pool, 4 * (2 * TABLE_END + 1));
    uint32_t *exp2_weights = pool_take(pool, 4 * EXP2_WEIGHTS);
    const int32_t shift = STATE_BITS - (int32_t)activation_bits, half = 1 << shift >> 1;
    const int32_t amax = (int32_t)largest_activation(activation_bits);
    for (int32_t u = -TABLE_END; u <= TABLE_END; u++) {
        const int32_t place = u < 0 ? -u : u, tanh12 = u < 0 ? -TANH[place] : TANH[place];
        sigmoids[u + TABLE_END] = u < 0 ? ONE - SIGMOID[place] : SIGMOID[place];
        states_of[u + TABLE_END] = limited((tanh12 + half) >> shift, -amax, amax);
    }
    for (int32_t d = 0; d < EXP2_WEIGHTS; d++) exp2_weights[d] = d < EXP2_WEIGHTS - 1 ? EXP2[d % 32] >> d / 32 : 0;
    out->sigmoid = sigmoids, out->tanh = states_of, out->exp2 = exp2_weights;
}

void multiply(const int32_t *weights, int64_t rows, int64_t columns, const int32_t *x, const int32_t *b,
              int32_t *out) {
    for (int64_t r = 0; r < rows; r++, weights += columns) {
        Four sums = {b ? b[r] : 0, 0, 0, 0};
        int64_t c = 0;
        for (; c + 4 <= columns; c += 4) sums += *(const Four *)(weights + c) * *(const Four *)(x + c);
        for (; c < columns; c++) sums[0] += weights[c] * x[c];
        out[r] = sums[0] + sums[1] + sums[2] + sums[3];
    }
}

static int32_t looked_up(const int32_t *table, int32_t u) {
    return table[limited(u, -TABLE_END, TABLE_END) + TABLE_END];
}

void gru_step(const NetworkModel *net, const RecurrentModel *layer, const int32_t *px, int32_t *g) {
    const int64_t hidden = net->hidden;
    const int32_t shift = (int32_t)layer->shift, half = (int32_t)half_of_shift(shift);
    int32_t ph[GATES * MOST_HIDDEN];
    multiply(layer->wh, GATES * hidden, hidden, g, layer->bh, ph);
    for (int64_t u = 0; u < hidden; u++) {
        const int32_t z = looked_up(net->packed.sigmoid, (px[u] + ph[u] + half) >> shift);
        const int32_t r = looked_up(net->packed.sigmoid, (px[hidden + u] + ph[hidden + u] + half) >> shift);
        const int32_t past = limited((ph[2 * hidden + u] + half) >> shift, -RECURRENT_AMAX, RECURRENT_AMAX);
        const int32_t kept = (r * past + ONE / 2) >> STATE_BITS;
        const int32_t n = looked_up(net->packed.tanh, ((px[2 * hidden + u] + half) >> shift) + kept);
        g[u] = (z * g[u] + (ONE - z) * n + ONE / 2) >> STATE_BITS;
    }
}

void advance_states(const NetworkModel *net, int64_t t, int64_t index, int32_t *states) {
    const int64_t hidden = net->hidden, rows = GATES * hidden;
    const int32_t *products = net->packed.gru[0].tokens[t > 1] + index * rows;
    int32_t px[GATES * MOST_HIDDEN];
    for (int64_t r = 0; r < rows; r++) px[r] = products[r] + net->gru[0].bi[(t - 1) * rows + r];
    for (int64_t j = 0; j < net->layers; j++) {
        if (j) multiply(net->gru[j].wi[0], rows, hidden, states + (j - 1) * hidden, net->gru[j].bi, px);
        gru_step(net, net->gru + j, px, states + j * hidden);
    }
}

/* Biases with the half of a rounding. */
static int32_t *rounded(Pool *pool, const int32_t *biases, int64_t n, int64_t period, int64_t shift) {
    int32_t *out = pool_zeros(pool, 4 * n);
    for (int64_t i = 0; i < n; i++) out[i] = (int32_t)(biases[i % period] + half_of_shift(shift));
    return out;
}

static Layer products_layer(Pool *pool, const int32_t *weights, int64_t rows, int64_t columns, const int32_t *biases) {
    const Linear layer = {rows, columns, 0, weights, biases};
    return packed_layer(pool, &layer, 0, columns, biases, 0, -UNBOUNDED, UNBOUNDED);
}

static void pack_mixer(Pool *pool, NetworkModel *net) {
    const Linear *mixer = &net->mixer;
    const int64_t hidden = net->hidden;
    const int32_t *biases = rounded(pool, mixer->biases, mixer->rows, mixer->rows, mixer->shift);
    net->packed.mix_embedding = packed_layer(pool, mixer, 0, hidden, biases, 0, -UNBOUNDED, UNBOUNDED);
    net->packed.mix_state = packed_layer(pool, mixer, hidden, hidden, NULL, 0, -UNBOUNDED, UNBOUNDED);
    net->packed.mix_shift = mixer->shift;
    int32_t *start = pool_zeros(pool, 4 * (mixer->rows + mixer->rows % 2));
    for (int64_t r = 0; r < mixer->rows; r++)
        multiply(mixer->weights + (2 * r + 1) * hidden, 1, hidden, net->gru[net->layers - 1].start, NULL, start + r);
    net->packed.mix_start = start;
}

void pack_network(Model *m) {
    NetworkModel *net = m->network;
    Network *out = &net->packed;
    Pool *pool = &m->pool;
    *out = (Network){.classes = net->classes, .own = net->own, .attributes = net->attributes, .latents = net->latents,
                     .latent_shift = net->latent_shift, .grid = net->grid, .amax = net->amax, .hidden = net->hidden,
                     .layers = net->layers};
    out->embed[0] = whole_layer(pool, &net->embed1, 0, net->amax);
    out->embed[1] = whole_layer(pool, &net->embed2, -net->amax, net->amax);
    pack_mixer(pool, net);
    fill_tables(pool, net->activation_bits, out);
    for (int64_t j = 0; j < net->layers; j++) {
        const RecurrentModel *layer = net->gru + j;
        const int64_t rows = GATES * net->hidden, biases = j ? rows : rows * net->tokens;
        const int32_t *with_half = rounded(pool, layer->bi, biases, biases, layer->shift);
        out->gru[j].biases = with_half, out->gru[j].shift = layer->shift;
        if (j) out->gru[j].inputs = products_layer(pool, layer->wi[0], rows, net->hidden, with_half);
        out->gru[j].recurrent = products_layer(pool, layer->wh, rows, net->hidden, layer->bh);
    }
}

/* (size, R + 1) codewords of a head as activations (SPEC 10.5). */
static int32_t *codewords(Model *m, const Book *book) {
    const NetworkModel *net = m->network;
    const int64_t dims = net->dims, shift = net->codeword_shift, half = half_of_shift(shift);
    int32_t *e = pool_take(&m->pool, 4 * book->size * (dims + 1)), *out = e;
    for (int64_t k = 0; k < book->size; k++) {
        int32_t squares = 0;
        for (int64_t i = 0; i < dims; i++, out++) {
            *out = limited((int32_t)((book->words[k * book->dims + i] + half) >> shift), -(int32_t)net->amax,
                           (int32_t)net->amax);
            squares += *out * *out;
        }
        *out++ = limited(squares ? 8 * (32 - __builtin_clz((uint32_t)squares)) : 0, 0, (int32_t)net->amax);
    }
    return e;
}

/* Products of the codewords of book b with the input weights of the first recurrent layer, and for book 0 the states
after each of them. */
static void pack_tokens(Model *m, int64_t b) {
    NetworkModel *net = m->network;
    const int64_t rows = GATES * net->hidden, width = net->dims + 1, size = net->layers * net->hidden;
    const HeadModel *head = net->head + b;
    int32_t *tokens = pool_take(&m->pool, 4 * head->size * rows);
    for (int64_t k = 0; k < head->size; k++)
        multiply(net->gru[0].wi[b], rows, width, head->e + k * width, NULL, tokens + k * rows);
    net->packed.gru[0].tokens[b] = tokens;
    if (b || !net->tokens) return;
    int32_t *after = pool_take(&m->pool, 4 * head->size * size);
    for (int64_t k = 0; k < head->size; k++) {
        for (int64_t j = 0; j < net->layers; j++)
            memcpy(after + k * size + j * net->hidden, net->gru[j].start, 4 * (size_t)net->hidden);
        advance_states(net, 1, k, after + k * size);
    }
    net->packed.after_first = after;
}

/* The rest of R-10.5-6, and R-10.5-7, of the head of codebook b. */
void pack_head(Model *m, int64_t b) {
    NetworkModel *net = m->network;
    HeadModel *head = net->head + b;
    const Book *book = m->books + b;
    const int64_t width = net->dims + 1;
    demand(b < net->heads && head->size == book->size, BAD);
    head->e = codewords(m, book);
    Head *out = net->packed.heads + b;
    out->project = whole_layer(&m->pool, &head->project, -net->amax, net->amax);
    out->size = head->size;
    const Linear top = {head->size, width, head->shift, head->e, head->biases};
    for (int64_t k = 0; k < head->size; k++)
        demand(row_fits(head->e + k * width, width, head->biases[k], head->shift, net->amax, ACCUMULATOR_LIMIT), BAD);
    out->top = whole_layer(&m->pool, &top, -UNBOUNDED, UNBOUNDED);
    float *leading = pool_take(&m->pool, 4 * book->size * net->latents);
    for (int64_t k = 0; k < book->size; k++)
        for (int64_t c = 0; c < net->latents; c++)
            leading[k * net->latents + c] = (float)book->words[k * book->dims + c];
    net->packed.books[b] = leading, net->packed.sizes[b] = book->size;
    pack_tokens(m, b);
}

void lend_network(const NetworkModel *net, Pool *scratch, Indices *s, int64_t stages) {
    const Network *packed = &net->packed;
    const int64_t count = s->count, blocks = (count + BLOCK - 1) / BLOCK, hidden = net->hidden;
    const int64_t mixed = packed->mix_state.rows, state = hidden + (hidden + 1) / 2, lane = 4 * BLOCK;
    int64_t most = 0, words = 0;
    for (int64_t b = 0; b < net->heads; b++) {
        const Head *head = packed->heads + b;
        most = head->top.rows > most ? head->top.rows : most;
        words = head->top.words > words ? head->top.words : words;
    }
    const int64_t embedded = packed->embed[0].words + packed->embed[1].words + packed->mix_embedding.words;
    const int64_t recurrent = 2 * (GATES * hidden + 1) + state;
    const int64_t mixing = mixed + (words + most > mixed + state ? words + most : mixed + state);
    int64_t lanes = embedded > recurrent ? embedded : recurrent;
    lanes = mixing > lanes ? mixing : lanes;
    s->chosen = pool_take(scratch, 8 * count), s->anchors = pool_take(scratch, 8 * count);
    s->means = pool_take(scratch, lane * (net->attributes + net->latents + 4));
    s->inputs = pool_take(scratch, lane * (net->inputs + 1));
    s->lanes = pool_take(scratch, lane * lanes);
    s->shares = pool_take(scratch, lane * blocks * mixed);
    s->states = pool_take(scratch, stages > MOST_HEADS ? lane * blocks * net->layers * hidden : 0);
    s->weights = pool_take(scratch, lane * (most + 1));
}
