/* Blocks: a number of each of BLOCK anchors side by side. */

#ifndef SCAR_LANES_H
#define SCAR_LANES_H

#include "kernel.h"

typedef int32_t Four __attribute__((vector_size(16), aligned(4), may_alias));

#if defined(__clang__)
#define MIXED(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define MIXED(a, b, ...) __builtin_shuffle(a, b, (Four){__VA_ARGS__})
#endif

/* Two activations, or two weights, in a word: the first in its lower half. */
INLINE int32_t pair_of(int32_t first, int32_t second) {
    return (int32_t)((uint32_t)second << 16 | ((uint32_t)first & 0xffff));
}

INLINE int32_t limited(int32_t value, int32_t low, int32_t high) {
    return value < low ? low : value > high ? high : value;
}

/* The i-th anchor of a pass of `wide` and those after it; lanes beyond the last repeat it. */
INLINE void block_anchors(const int64_t *anchors, int64_t wide, int64_t i, int64_t *out) {
    for (int64_t j = 0; j < BLOCK; j++) out[j] = anchors[i + j < wide ? i + j : wide - 1];
}

/* Columns of four words from word `at` on of a row for each anchor. */
INLINE void four_columns(const int32_t *const rows[BLOCK], int64_t at, int32_t out[4][BLOCK]) {
    for (int j = 0; j < BLOCK; j += 4) {
        const Four a = *(const Four *)(rows[j] + at), b = *(const Four *)(rows[j + 1] + at);
        const Four c = *(const Four *)(rows[j + 2] + at), d = *(const Four *)(rows[j + 3] + at);
        const Four ab = MIXED(a, b, 0, 4, 1, 5), cd = MIXED(c, d, 0, 4, 1, 5);
        const Four last_ab = MIXED(a, b, 2, 6, 3, 7), last_cd = MIXED(c, d, 2, 6, 3, 7);
        *(Four *)(out[0] + j) = MIXED(ab, cd, 0, 1, 4, 5);
        *(Four *)(out[1] + j) = MIXED(ab, cd, 2, 3, 6, 7);
        *(Four *)(out[2] + j) = MIXED(last_ab, last_cd, 0, 1, 4, 5);
        *(Four *)(out[3] + j) = MIXED(last_ab, last_cd, 2, 3, 6, 7);
    }
}

INLINE void put_pairs(const int32_t *restrict first, const int32_t *restrict second, int32_t *restrict out) {
    for (int j = 0; j < BLOCK; j++) out[j] = pair_of(first[j], second[j]);
}

#endif
