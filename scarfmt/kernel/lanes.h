/* Blocks: a number of each of BLOCK anchors side by side, and linear layers over them (SPEC 10.1). */

#ifndef SCAR_LANES_H
#define SCAR_LANES_H

#include "kernel.h"

#define ROWS 5 /* rows of weights multiplied at once: sums that fit in 16 registers of AVX2 beside operands */

typedef int32_t IntLanes __attribute__((vector_size(4 * BLOCK), aligned(4), may_alias));

/* Adds the products of ROWS rows of weights, `stride` apart, with n inputs. */
INLINE void add_products(const float *weights, int64_t stride, const float *x, int64_t n, Lanes out[ROWS]) {
    const Lanes *input = (const Lanes *)x;
    Lanes a = out[0], b = out[1], c = out[2], d = out[3], e = out[4];
    for (int64_t k = 0; k < n; k++, weights++) {
        a += weights[0] * input[k];
        b += weights[stride] * input[k];
        c += weights[2 * stride] * input[k];
        d += weights[3 * stride] * input[k];
        e += weights[4 * stride] * input[k];
    }
    out[0] = a, out[1] = b, out[2] = c, out[3] = d, out[4] = e;
}

/* The largest integers not above numbers within +-2^24. */
INLINE void floor_lanes(Lanes *x) {
    const Lanes whole = __builtin_convertvector(__builtin_convertvector(*x, IntLanes), Lanes);
    /* A comparison gives -1 where it holds. */
    *x = whole + __builtin_convertvector(whole > *x, Lanes);
}

/* `yes` where a comparison holds, else what is there. */
INLINE void choose(Lanes *x, const IntLanes *holds, const Lanes *yes) {
    *x = (Lanes)((*holds & (IntLanes)*yes) | (~*holds & (IntLanes)*x));
}

INLINE void clamp_lanes(Lanes *x, float low, float high) {
    const Lanes zero = {0}, lowest = zero + low, highest = zero + high;
    const IntLanes below = *x < lowest, above = *x > highest;
    choose(x, &below, &lowest);
    choose(x, &above, &highest);
}

INLINE int64_t filled(int64_t rows) { return (rows + ROWS - 1) / ROWS * ROWS; }

/* The i-th anchor of a pass of `wide` and those after it; lanes beyond the last repeat it. */
INLINE void block_anchors(const int64_t *anchors, int64_t wide, int64_t i, int64_t *out) {
    for (int64_t j = 0; j < BLOCK; j++) out[j] = anchors[i + j < wide ? i + j : wide - 1];
}

#endif
