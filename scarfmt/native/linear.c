#include "linear.h"

#include "lanes.h"

int32_t *read_weights(LinearReader *reader, Pool *pool, int64_t n, const char *id) {
    return read_array(&reader->numbers, &reader->weights, pool, n, 0, MOST_WEIGHT, id);
}

Linear read_linear(LinearReader *reader, Pool *pool, int64_t rows, int64_t columns, const char *id) {
    const int64_t shift = read_limited(&reader->numbers, &reader->shift, MOST_U8);
    const int32_t *weights = read_weights(reader, pool, rows * columns, id);
    return (Linear){rows, columns, shift, weights, read_shifted(&reader->numbers, &reader->biases, pool, rows)};
}

int row_fits(const int32_t *weights, int64_t columns, int64_t bias, int64_t shift, int64_t amax, int64_t limit) {
    int64_t sum = 0;
    for (int64_t c = 0; c < columns; c++) sum += weights[c] < 0 ? -(int64_t)weights[c] : weights[c];
    return sum * amax + (bias < 0 ? -bias : bias) + half_of_shift(shift) < limit;
}

int linear_fits(const Linear *layer, int64_t amax) {
    if (layer->rows < 1 || layer->columns < 1 || layer->shift > MOST_SHIFT) return 0;
    for (int64_t r = 0; r < layer->rows; r++)
        if (!row_fits(layer->weights + r * layer->columns, layer->columns, layer->biases[r], layer->shift, amax,
                      ACCUMULATOR_LIMIT))
            return 0;
    return 1;
}

int32_t *paired_words(Pool *pool, const int32_t *numbers, int64_t rows, int64_t stride, int64_t first,
                      int64_t columns, int64_t even) {
    const int64_t words = (columns + 1) / 2, filled = even ? rows + rows % 2 : rows;
    int32_t *out = pool_zeros(pool, 4 * words * filled);
    for (int64_t r = 0; r < rows; r++)
        for (int64_t c = 0; c < columns; c += 2) {
            const int32_t *at = numbers + r * stride + first + c;
            out[r * words + c / 2] = pair_of(at[0], c + 1 < columns ? at[1] : 0);
        }
    return out;
}

Layer packed_layer(Pool *pool, const Linear *layer, int64_t first, int64_t columns, const int32_t *biases,
                   int64_t shift, int64_t low, int64_t high) {
    const int64_t rows = layer->rows + layer->rows % 2;
    int32_t *rounded = pool_zeros(pool, 4 * rows);
    for (int64_t r = 0; r < layer->rows; r++)
        rounded[r] = (int32_t)((biases ? biases[r] : 0) + half_of_shift(shift));
    return (Layer){rows, (columns + 1) / 2,
                   paired_words(pool, layer->weights, layer->rows, layer->columns, first, columns, 1), rounded,
                   (int32_t)shift, (int32_t)low, (int32_t)high, 0};
}

Layer whole_layer(Pool *pool, const Linear *layer, int64_t low, int64_t high) {
    return packed_layer(pool, layer, 0, layer->columns, layer->biases, layer->shift, low, high);
}
