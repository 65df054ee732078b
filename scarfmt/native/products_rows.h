/* The layers of products.h, compiled once for every kind of vectors. The file that includes this one says which:

TARGET: the attribute of its functions. MOST_ROWS: rows of weights that are multiplied at once, so that their sums and
what they need stay in registers. PRODUCTS, NAME: what it is called. And what is done with Sums, a number of every
anchor of a block: load_sums, store_sums, repeated, chosen, between, paired, opened, add_pairs. */

#include "products.h"

#define ROOM 10 /* for the most that any has */
#define PART static inline __attribute__((always_inline, TARGET))

/* The products of `rows` rows of weights, `stride` words apart, with words of inputs. */
PART void add_words(Sums *sums, int rows, const int32_t *weights, int64_t stride, const int32_t *x, int64_t words) {
    for (int64_t k = 0; k < words; k++, weights++, x += BLOCK) {
        const Pairs here = opened(load_sums(x));
#pragma GCC unroll 12
        for (int r = 0; r < rows; r++) sums[r] = add_pairs(sums[r], here, weights + r * stride);
    }
}

/* Rows `first` and on of a predictor: the two direct ones, which come first, are kept in `out`, hidden units go to
`hidden` in pairs. */
PART void predictor_rows(const Predictor *p, int64_t first, int rows, const int32_t *shared, const int32_t *own,
                         const int32_t *classes, Sums out[2], int32_t *hidden) {
    const int64_t stride = p->shared + p->own;
    const int32_t *weights = p->weights + first * stride;
    Sums sums[ROOM];
#pragma GCC unroll 12
    for (int r = 0; r < rows; r++) sums[r] = chosen(p->starts + (first + r) * CLASS_STARTS, classes);
    add_words(sums, rows, weights, stride, shared, p->shared);
    add_words(sums, rows, weights + p->shared, stride, own, p->own);
    if (!first) out[0] = sums[0], out[1] = sums[1];
#pragma GCC unroll 12
    for (int r = 0; r < rows; r += 2) {
        if (!r && !first) continue;
        const Sums one = between(sums[r], p->shift, 0, AMAX), other = between(sums[r + 1], p->shift, 0, AMAX);
        store_sums(hidden + (first + r - 2) / 2 * BLOCK, paired(one, other));
    }
}

/* How many rows to do of those that are left, an even number. */
PART int64_t at_once(int64_t left) {
    if (left >= MOST_ROWS) return MOST_ROWS;
    return MOST_ROWS > 8 && left >= 8 ? 8 : MOST_ROWS > 6 && left >= 6 ? 6 : left >= 4 ? 4 : 2;
}

__attribute__((TARGET)) static void contexts(const Predictor *p, const int32_t *shared, const int32_t *own,
                                             const int32_t *classes, int32_t *context) {
    int32_t hidden[MOST_UNITS / 2 * BLOCK];
    Sums out[2] = {repeated(0), repeated(0)};
    for (int64_t row = 0, done; row < p->rows; row += done) switch (done = at_once(p->rows - row)) {
            case 10: predictor_rows(p, row, 10, shared, own, classes, out, hidden); break;
            case 8: predictor_rows(p, row, 8, shared, own, classes, out, hidden); break;
            case 6: predictor_rows(p, row, 6, shared, own, classes, out, hidden); break;
            case 4: predictor_rows(p, row, 4, shared, own, classes, out, hidden); break;
            default: predictor_rows(p, row, 2, shared, own, classes, out, hidden);
        }
    add_words(out, 2, p->output, p->rows / 2 - 1, hidden, p->rows / 2 - 1);
    const Sums one = between(out[0], p->output_shift, 0, p->last[0]);
    const Sums other = between(out[1], p->output_shift, 0, p->last[1]);
    const int32_t places = pair_of(p->last[1] + 1, 1);
    store_sums(context, add_pairs(repeated(0), opened(paired(one, other)), &places));
}

/* Rows `first` and on of a layer, as numbers or in pairs. */
PART void layer_rows(const Layer *l, int64_t first, int rows, const int32_t *x, int in_pairs, int32_t *out) {
    Sums sums[ROOM];
#pragma GCC unroll 12
    for (int r = 0; r < rows; r++) sums[r] = repeated(l->biases[first + r]);
    add_words(sums, rows, l->weights + first * l->words, l->words, x, l->words);
#pragma GCC unroll 12
    for (int r = 0; r < rows; r += 2) {
        const Sums one = between(sums[r], l->shift, l->low, l->high);
        const Sums other = between(sums[r + 1], l->shift, l->low, l->high);
        if (in_pairs) {
            store_sums(out + (first + r) / 2 * BLOCK, paired(one, other));
        } else {
            store_sums(out + (first + r) * BLOCK, one);
            store_sums(out + (first + r + 1) * BLOCK, other);
        }
    }
}

PART void layer(const Layer *l, const int32_t *x, int in_pairs, int32_t *out) {
    for (int64_t row = 0, done; row < l->rows; row += done) switch (done = at_once(l->rows - row)) {
            case 10: layer_rows(l, row, 10, x, in_pairs, out); break;
            case 8: layer_rows(l, row, 8, x, in_pairs, out); break;
            case 6: layer_rows(l, row, 6, x, in_pairs, out); break;
            case 4: layer_rows(l, row, 4, x, in_pairs, out); break;
            default: layer_rows(l, row, 2, x, in_pairs, out);
        }
}

__attribute__((TARGET)) static void rows(const Layer *l, const int32_t *x, int32_t *out) { layer(l, x, 0, out); }

__attribute__((TARGET)) static void pairs(const Layer *l, const int32_t *x, int32_t *out) { layer(l, x, 1, out); }

const Products PRODUCTS = {NAME, contexts, rows, pairs};
