/* DECODER_MLP, SCENE_MLP and CODEBOOKS blocks (SPEC 7.8, 7.9). */

#include "numbers.h"
#include "tile.h"

#define MOST_WEIGHTS (1ll << 20)
#define MOST_WIDTH 1024
#define MOST_CODEWORDS 4096
#define MOST_WORD 65535
#define MOST_NETWORKS 8

/* A block of networks, the models of its fields, and how many weights it has so far. */
typedef struct {
    Rans rans;
    NumberModel networks, layers, rows, columns, weights, scales, biases;
    int64_t declared;
} NetworkNumbers;

/* n finite numbers, and zeros up to `room`. */
static float *read_finite(Rans *rans, NumberModel *model, Pool *pool, int64_t n, int64_t room) {
    float *numbers = pool_zeros(pool, 4 * room);
    int finite = 1;
    for (int64_t i = 0; i < n; i++) {
        numbers[i] = read_f32(rans, model);
        finite &= __builtin_isfinite(numbers[i]) != 0;
    }
    demand(finite, "bad-mlp");
    return numbers;
}

/* Column after column, without the scales. */
static float *read_integers(NetworkNumbers *numbers, Pool *pool, const MlpLayer *layer) {
    float *weights = pool_zeros(pool, 4 * layer->columns * layer->stride);
    int fits = 1;
    for (int64_t row = 0; row < layer->rows; row++)
        for (int64_t column = 0; column < layer->columns; column++) {
            const int64_t weight = read_signed(&numbers->rans, &numbers->weights);
            fits &= weight == (int16_t)weight;
            weights[column * layer->stride + row] = (float)weight;
        }
    demand(fits, "bad-mlp");
    return weights;
}

static void read_mlp_layer(NetworkNumbers *numbers, Pool *pool, int64_t inputs, MlpLayer *out) {
    Rans *rans = &numbers->rans;
    out->rows = read_limited(rans, &numbers->rows, MOST_WIDTH);
    demand(out->rows >= 1, "bad-mlp");
    out->columns = read_limited(rans, &numbers->columns, MOST_WIDTH);
    demand(out->columns >= 1 && (!inputs || inputs == out->columns), "bad-mlp");
    numbers->declared += out->rows * out->columns;
    demand(numbers->declared <= MOST_WEIGHTS, "content-limit");
    out->stride = (out->rows + FILLED - 1) / FILLED * FILLED;
    float *weights = read_integers(numbers, pool, out);
    const float *scales = read_finite(rans, &numbers->scales, pool, out->rows, out->rows);
    out->biases = read_finite(rans, &numbers->biases, pool, out->rows, out->stride);
    for (int64_t i = 0; i < out->columns * out->stride; i += out->stride)
        for (int64_t row = 0; row < out->rows; row++)
            weights[i + row] = (float)((double)weights[i + row] * (double)scales[row]);
    out->weights = weights;
}

static void read_mlp(NetworkNumbers *numbers, Pool *pool, Mlp *out) {
    out->layers = read_limited(&numbers->rans, &numbers->layers, MOST_MLP_LAYERS);
    demand(out->layers >= 1, "bad-mlp");
    for (int64_t l = 0; l < out->layers; l++)
        read_mlp_layer(numbers, pool, l ? out->layer[l - 1].rows : 0, out->layer + l);
}

/* The networks of a block, the first `most` of them into `out`; returns how many it holds. */
int64_t read_networks(Model *m, Body block, Mlp *out, int64_t most) {
    NetworkNumbers numbers = {.rans = open_stream(block)};
    const int64_t count = read_limited(&numbers.rans, &numbers.networks, MOST_NETWORKS);
    for (int64_t i = 0; i < count; i++) {
        Mlp other;
        read_mlp(&numbers, &m->pool, i < most ? out + i : &other);
    }
    seal_stream(&numbers.rans);
    return count;
}

static const int32_t *read_words(Reader *reader, Pool *pool, int64_t size, int64_t dims) {
    int32_t *words = pool_take(pool, 4 * size * dims), column[MOST_CODEWORDS];
    for (int64_t d = 0; d < dims; d++) {
        int fits = 1;
        read_rice(reader, size, column);
        for (int64_t i = 0; i < size; i++) {
            fits &= column[i] >= -MOST_WORD && column[i] <= MOST_WORD;
            words[i * dims + d] = column[i];
        }
        demand(fits, "bad-codebook");
    }
    return words;
}

/* The CODEBOOKS block of layer k, if books stand in it (R-7.8-1, R-7.8-2). */
void read_codebooks(Model *m, int64_t k) {
    const Body block = m->blocks[k][CODEBOOKS_BLOCK];
    int64_t found = 0, before = -1, wanted = 0;
    for (int64_t b = 0; b < BOOKS; b++) wanted |= (int64_t)(m->book_layer[b] == k) << b;
    if (!wanted) return;
    demand(block.bytes != NULL, "missing-block");
    Reader reader = {block.bytes, block.length, 0};
    const int64_t dims = read_count(&reader, MOST_COMPONENTS);
    demand(dims >= 1, "bad-codebook");
    const int64_t count = read_count(&reader, BOOKS);
    demand(count >= 1, "bad-codebook");
    for (int64_t i = 0; i < count; i++) {
        const int64_t number = read_u8(&reader), size = read_count(&reader, MOST_CODEWORDS);
        demand(number < BOOKS && number > before && size >= 1, "bad-codebook");
        const int32_t *words = read_words(&reader, &m->pool, size, dims);
        if (wanted >> number & 1) m->books[number] = (Book){size, dims, words};
        found |= 1ll << number, before = number;
    }
    read_end(&reader);
    demand(found == wanted, "bad-codebook");
}
