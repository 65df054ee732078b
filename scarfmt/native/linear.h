/* Integer layers as blocks hold them, and as the kernel multiplies them (SPEC 10.1). */

#ifndef SCAR_LINEAR_H
#define SCAR_LINEAR_H

#include "numbers.h"

#define MOST_WEIGHT 32767
#define MOST_SHIFT 24
#define UNBOUNDED (1 << 25) /* no sum reaches it */
#define ACCUMULATOR_LIMIT (1ll << 24)

/* (rows, columns) weights, (rows) biases. */
typedef struct {
    int64_t rows, columns, shift;
    const int32_t *weights, *biases;
} Linear;

static inline int64_t half_of_shift(int64_t shift) { return (int64_t)1 << shift >> 1; }

static inline int64_t largest_activation(int64_t bits) { return ((int64_t)1 << (bits - 1)) - 1; }

/* A block with layers, and the models of their fields. */
typedef struct {
    Numbers numbers;
    NumberModel shift, weights;
    ShiftedModel biases;
} LinearReader;

/* n weights; those out of range are refused by `id`. */
int32_t *read_weights(LinearReader *reader, Pool *pool, int64_t n, const char *id);

Linear read_linear(LinearReader *reader, Pool *pool, int64_t rows, int64_t columns, const char *id);

/* Whether the sum of |weights| * amax + |bias| + half of the shift stays below the limit in a row. */
int row_fits(const int32_t *weights, int64_t columns, int64_t bias, int64_t shift, int64_t amax, int64_t limit);

/* R-10.1-1 but the range of the weights. */
int linear_fits(const Linear *layer, int64_t amax);

/* (rows, stride) numbers, of which the columns first..first + columns - 1 are taken, as (rows, columns / 2 rounded up)
words, with `even` filled up to an even number of rows. */
int32_t *paired_words(Pool *pool, const int32_t *numbers, int64_t rows, int64_t stride, int64_t first,
                      int64_t columns, int64_t even);

/* clamp((W x + b + half) >> shift) of those columns; biases: NULL for none. */
Layer packed_layer(Pool *pool, const Linear *layer, int64_t first, int64_t columns, const int32_t *biases,
                   int64_t shift, int64_t low, int64_t high);

/* All of a layer, clamped to low..high. */
Layer whole_layer(Pool *pool, const Linear *layer, int64_t low, int64_t high);

#endif
