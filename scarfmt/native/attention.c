/* Indices by an index network with attention (SPEC 10.5), one anchor at a time: files of it are rare, and the kernel
has none. States are made anew for each stage, so that none has to be kept. */

#include <string.h>

#include "cells.h"
#include "network.h"
#include "rans.h"

#define SCORE_LIMIT 127
#define SHARES 256 /* that the attention of an anchor is divided into */

void scar_embedding_inputs(const Embedding *e, const Cells *cells, const int64_t *anchors, const int64_t *rows,
                           int64_t m, float *out);

typedef struct {
    const NetworkModel *net;
    Indices *s;
    int32_t *h;         /* (anchors of a pass, H) embeddings */
    float *columns;     /* (N) */
    int32_t *x, *y, *o; /* (N), (Y), (R + 1) */
    int32_t *logits;    /* of all codewords, and their weights */
    uint32_t *weights;
    double *numbers;    /* columns of the cells */
} Work;

/* clamp(round_shift(W x + b, s)). */
static void apply(const Linear *layer, const int32_t *x, int64_t low, int64_t high, int32_t *out) {
    const int32_t half = (int32_t)half_of_shift(layer->shift);
    multiply(layer->weights, layer->rows, layer->columns, x, layer->biases, out);
    for (int64_t r = 0; r < layer->rows; r++)
        out[r] = limited((out[r] + half) >> layer->shift, (int32_t)low, (int32_t)high);
}

/* The sums of cells with an anchor that has `stages` indices. */
static void add_anchor(Work *w, int64_t anchor, int64_t stages) {
    const NetworkModel *net = w->net;
    const Indices *s = w->s;
    double *latents = w->numbers + net->attributes;
    for (int64_t c = 0; c < net->attributes; c++) w->numbers[c] = s->settled[anchor * net->attributes + c];
    for (int64_t c = 0; c < net->latents; c++) latents[c] = 0;
    for (int64_t stage = 0; stage < stages; stage++) {
        const float *word = net->packed.books[stage > 0] + s->indices[anchor * s->stages + stage] * net->latents;
        for (int64_t c = 0; c < net->latents; c++) latents[c] += word[c];
    }
    add_to_cells(&s->cells, anchor, w->numbers, 1);
}

static void embed(Work *w, int64_t anchor, int32_t *h) {
    const NetworkModel *net = w->net;
    const Indices *s = w->s;
    const Embedding e = {net->classes, net->own, net->attributes, net->latents, net->latent_shift, net->grid, net->amax,
                         s->classes, s->settled, s->features};
    scar_embedding_inputs(&e, &s->cells, &anchor, &anchor, 1, w->columns);
    for (int64_t c = 0; c < net->inputs; c++) w->x[c] = (int32_t)w->columns[c];
    int32_t embedded[MOST_HIDDEN];
    apply(&net->embed1, w->x, 0, net->amax, embedded);
    apply(&net->embed2, embedded, -net->amax, net->amax, h);
}

/* What is kept of the states before each stage. */
typedef struct {
    int32_t values[HISTORY][MOST_HIDDEN];
    int32_t scores[HISTORY];
} History;

static void remember(const NetworkModel *net, const int32_t *query, const int32_t *state, History *history, int64_t t) {
    int32_t key[MOST_HIDDEN], score = 0;
    apply(&net->key, state, -SCORE_LIMIT, SCORE_LIMIT, key);
    apply(&net->value, state, -net->amax, net->amax, history->values[t]);
    for (int64_t i = 0; i < net->hidden; i++) score += query[i] * key[i];
    history->scores[t] = (score + (int32_t)half_of_shift(net->score_shift)) >> net->score_shift;
}

/* Attends to m states. */
static void attend(const NetworkModel *net, const History *history, int64_t m, int32_t *out) {
    int32_t most = history->scores[0], shares[HISTORY];
    uint32_t total = 0;
    for (int64_t t = 1; t < m; t++) most = history->scores[t] > most ? history->scores[t] : most;
    for (int64_t t = 0; t < m; t++) {
        const int32_t below = most - history->scores[t];
        shares[t] = (int32_t)net->packed.exp2[below < EXP2_END ? below : EXP2_END];
        total += (uint32_t)shares[t];
    }
    for (int64_t t = 0; t < m; t++) shares[t] = (int32_t)(SHARES * (uint32_t)shares[t] / total);
    for (int64_t i = 0; i < net->hidden; i++) {
        int32_t mean = 0;
        for (int64_t t = 0; t < m; t++) mean += shares[t] * history->values[t][i];
        out[i] = limited((mean + SHARES / 2) >> 8, -(int32_t)net->amax, (int32_t)net->amax);
    }
}

/* y of `stage` of an anchor (SPEC 10.5, mixed). */
static void mix(Work *w, int64_t anchor, int64_t stage, const int32_t *h) {
    const NetworkModel *net = w->net;
    const Indices *s = w->s;
    const int64_t hidden = net->hidden;
    int32_t states[MOST_LAYERS * MOST_HIDDEN], query[MOST_HIDDEN], both[2 * MOST_HIDDEN];
    History history;
    const int32_t *last = states + (net->layers - 1) * hidden;
    for (int64_t j = 0; j < net->layers; j++) memcpy(states + j * hidden, net->gru[j].start, 4 * (size_t)hidden);
    apply(&net->query, h, -SCORE_LIMIT, SCORE_LIMIT, query);
    remember(net, query, last, &history, 0);
    for (int64_t t = 1; t < stage; t++) {
        advance_states(net, t, s->indices[anchor * s->stages + t - 1], states);
        remember(net, query, last, &history, t);
    }
    memcpy(both, h, 4 * (size_t)hidden);
    attend(net, &history, stage, both + hidden);
    apply(&net->mixer, both, 0, net->amax, w->y);
}

/* The index of an anchor. */
static int64_t read_one(Work *w, Rans *rans, const HeadModel *head, const Head *packed) {
    const Layer *top = &packed->top;
    uint64_t total = 0;
    apply(&head->project, w->y, -w->net->amax, w->net->amax, w->o);
    w->o[w->net->dims + 1] = 0;
    int32_t most = INT32_MIN;
    for (int64_t k = 0; k < packed->size; k++) {
        const int32_t *weights = top->weights + k * top->words;
        int32_t sum = top->biases[k];
        for (int64_t i = 0; i < top->words; i++)
            sum += (int16_t)weights[i] * w->o[2 * i] + (weights[i] >> 16) * w->o[2 * i + 1];
        w->logits[k] = sum >> top->shift;
        most = w->logits[k] > most ? w->logits[k] : most;
    }
    for (int64_t k = 0; k < packed->size; k++) {
        const int32_t below = most - w->logits[k];
        w->weights[k] = w->net->packed.exp2[below < EXP2_END ? below : EXP2_END];
        total += w->weights[k];
    }
    return packed->size > 1 ? weighted(rans, w->weights, 1, total, (uint32_t)packed->size) : 0;
}

static void read_stage(Work *w, Rans *rans, int64_t stage, const int64_t *anchors, int64_t wide) {
    const NetworkModel *net = w->net;
    const Indices *s = w->s;
    for (int64_t i = 0; i < wide; i++) {
        if (s->before[anchors[i]] >= stage || s->after[anchors[i]] < stage) continue;
        mix(w, anchors[i], stage, w->h + i * net->hidden);
        const int64_t index = read_one(w, rans, net->head + (stage > 1), net->packed.heads + (stage > 1));
        s->indices[anchors[i] * s->stages + stage - 1] = (int16_t)index;
    }
}

static void read_pass(Work *w, Rans *rans, const int64_t *anchors, int64_t wide) {
    const NetworkModel *net = w->net;
    Indices *s = w->s;
    for (int64_t i = 0; i < wide; i++) embed(w, anchors[i], w->h + i * net->hidden);
    for (int64_t stage = 1; stage <= MOST_STAGES; stage++) read_stage(w, rans, stage, anchors, wide);
    for (int64_t i = 0; i < wide; i++) add_anchor(w, anchors[i], s->after[anchors[i]]);
}

void attentive_indices(Rans *rans, const NetworkModel *net, Indices *s, Pool *scratch) {
    int64_t chosen = 0, ends[MOST_PASSES], most = 1;
    for (int64_t b = 0; b < net->heads; b++) most = net->packed.heads[b].size > most ? net->packed.heads[b].size : most;
    Work w = {.net = net, .s = s};
    w.h = pool_take(scratch, 4 * s->count * net->hidden);
    w.columns = pool_take(scratch, 4 * net->inputs), w.x = pool_take(scratch, 4 * net->inputs);
    w.y = pool_take(scratch, 4 * net->mixed), w.o = pool_take(scratch, 4 * (net->dims + 2));
    w.logits = pool_take(scratch, 4 * most), w.weights = pool_take(scratch, 4 * most);
    w.numbers = pool_take(scratch, 8 * (net->attributes + net->latents));
    empty_cells(&s->cells);
    for (int64_t i = 0; i < s->count; i++)
        if (s->before[i] > 0) add_anchor(&w, i, s->before[i]);
    for (int64_t i = 0; i < s->count; i++) {
        s->chosen[chosen] = s->by_code[i];
        chosen += s->before[s->by_code[i]] < s->after[s->by_code[i]];
    }
    const int64_t passes = split_passes(s->chosen, chosen, s->passes_log2, s->anchors, ends);
    for (int64_t pass = 0, start = 0; pass < passes; start = ends[pass++])
        if (ends[pass] > start) read_pass(&w, rans, s->anchors + start, ends[pass] - start);
}
