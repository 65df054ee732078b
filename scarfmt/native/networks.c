/* DECODER_MLP, SCENE_MLP and CODEBOOKS blocks (SPEC 7.8, 7.9). */

#include "numbers.h"
#include "tile.h"

#define MOST_WIDTH 1024
#define MOST_CODEWORDS 4096
#define MOST_WORD 65535
#define MOST_NETWORKS 8

/* A block of networks and the models of its fields. */
typedef struct {
    Numbers numbers;
    NumberModel layers, rows, columns, weights, scales, biases;
} MlpReader;

/* n finite numbers, and zeros up to `room`. */
static float *read_finite(Numbers *numbers, NumberModel *model, Pool *pool, int64_t n, int64_t room) {
    spend(numbers, n);
    float *out = pool_zeros(pool, 4 * room);
    int finite = 1;
    for (int64_t i = 0; i < n; i++) {
        out[i] = next_f32(numbers, model);
        finite &= __builtin_isfinite(out[i]) != 0;
    }
    demand(finite, "bad-mlp");
    return out;
}

/* Column after column, without the scales. */
static float *read_integers(MlpReader *reader, Pool *pool, const MlpLayer *layer) {
    spend(&reader->numbers, layer->rows * layer->columns);
    float *weights = pool_zeros(pool, 4 * layer->columns * layer->stride);
    int fits = 1;
    for (int64_t row = 0; row < layer->rows; row++)
        for (int64_t column = 0; column < layer->columns; column++) {
            const int64_t weight = next_signed(&reader->numbers, &reader->weights);
            fits &= weight == (int16_t)weight;
            weights[column * layer->stride + row] = (float)weight;
        }
    demand(fits, "bad-mlp");
    return weights;
}

static void read_mlp_layer(MlpReader *reader, Pool *pool, int64_t inputs, MlpLayer *out) {
    Numbers *numbers = &reader->numbers;
    out->rows = read_limited(numbers, &reader->rows, MOST_WIDTH);
    demand(out->rows >= 1, "bad-mlp");
    out->columns = read_limited(numbers, &reader->columns, MOST_WIDTH);
    demand(out->columns >= 1 && (!inputs || inputs == out->columns), "bad-mlp");
    out->stride = (out->rows + FILLED - 1) / FILLED * FILLED;
    float *weights = read_integers(reader, pool, out);
    const float *scales = read_finite(numbers, &reader->scales, pool, out->rows, out->rows);
    out->biases = read_finite(numbers, &reader->biases, pool, out->rows, out->stride);
    for (int64_t i = 0; i < out->columns * out->stride; i += out->stride)
        for (int64_t row = 0; row < out->rows; row++)
            weights[i + row] = (float)((double)weights[i + row] * (double)scales[row]);
    out->weights = weights;
}

static void read_mlp(MlpReader *reader, Pool *pool, Mlp *out) {
    out->layers = read_limited(&reader->numbers, &reader->layers, MOST_MLP_LAYERS);
    demand(out->layers >= 1, "bad-mlp");
    for (int64_t l = 0; l < out->layers; l++)
        read_mlp_layer(reader, pool, l ? out->layer[l - 1].rows : 0, out->layer + l);
}

/* The networks of a block, the first `most` of them into `out`; returns how many it holds. */
int64_t read_networks(Model *m, Body block, Mlp *out, int64_t most) {
    MlpReader reader = {.numbers = open_numbers(m, block)};
    const int64_t count = read_once(&reader.numbers, MOST_NETWORKS);
    for (int64_t i = 0; i < count; i++) {
        Mlp other;
        read_mlp(&reader, &m->pool, i < most ? out + i : &other);
    }
    seal_numbers(&reader.numbers);
    return count;
}

/* A CODEBOOKS block and the models of its fields. */
typedef struct {
    Numbers numbers;
    NumberModel number, size, words[MOST_COMPONENTS];
} BookReader;

static const int32_t *read_words(BookReader *reader, Pool *pool, int64_t size, int64_t dims) {
    int32_t *words = pool_take(pool, 4 * size * dims);
    for (int64_t d = 0; d < dims; d++) {
        const int32_t *column =
            read_array(&reader->numbers, reader->words + d, &layer_scratch, size, 0, MOST_WORD, "bad-codebook");
        for (int64_t i = 0; i < size; i++) words[i * dims + d] = column[i];
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
    BookReader reader = {.numbers = open_numbers(m, block)};
    const int64_t dims = read_once(&reader.numbers, MOST_COMPONENTS);
    demand(dims >= 1, "bad-codebook");
    const int64_t count = read_once(&reader.numbers, BOOKS);
    demand(count >= 1, "bad-codebook");
    for (int64_t i = 0; i < count; i++) {
        const int64_t number = read_limited(&reader.numbers, &reader.number, MOST_U8);
        const int64_t size = read_limited(&reader.numbers, &reader.size, MOST_CODEWORDS);
        demand(number < BOOKS && number > before && size >= 1, "bad-codebook");
        const int32_t *words = read_words(&reader, &m->pool, size, dims);
        if (wanted >> number & 1) m->books[number] = (Book){size, dims, words};
        found |= 1ll << number, before = number;
    }
    seal_numbers(&reader.numbers);
    demand(found == wanted, "bad-codebook");
}
