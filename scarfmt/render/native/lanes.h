/* Vectors of LANES Gaussians: of each, the same operations in the same order as on its own. */

#ifndef SCAR_RENDER_LANES_H
#define SCAR_RENDER_LANES_H

#include <stdint.h>
#include <string.h>

#include "../../native/compiler.h"
#include "numbers.h"

#define LANES 8
typedef float V __attribute__((vector_size(4 * LANES)));
typedef int32_t M __attribute__((vector_size(4 * LANES)));
typedef double D __attribute__((vector_size(8 * LANES)));

INLINE V all(float value) { return value - (V){0}; }
INLINE V where(M mask, V yes, V no) { return (V)((mask & (M)yes) | (~mask & (M)no)); }
INLINE V larger(V a, V b) { return where(a > b, a, b); }
INLINE V smaller(V a, V b) { return where(a < b, a, b); }
INLINE V magnitude(V a) { return (V)((M)a & INT32_MAX); }
INLINE V narrowed(D a) { return __builtin_convertvector(a, V); }
INLINE D widened(V a) { return __builtin_convertvector(a, D); }
/* Of numbers from 0 to below 2^31. */
INLINE V rounded_down(V a) { return __builtin_convertvector(__builtin_convertvector(a, M), V); }

INLINE int any(M mask) {
    int32_t found = 0;
    for (int j = 0; j < LANES; j++) found |= mask[j];
    return found != 0;
}

INLINE V root(V a) {
    float each[LANES];
    memcpy(each, &a, sizeof a);
    for (int j = 0; j < LANES; j++) each[j] = __builtin_sqrtf(each[j]);
    memcpy(&a, each, sizeof a);
    return a;
}

INLINE V log2_of_each(V a) {
    float each[LANES];
    memcpy(each, &a, sizeof a);
    for (int j = 0; j < LANES; j++) each[j] = log2_of(each[j]);
    memcpy(&a, each, sizeof a);
    return a;
}

/* from[stride * row] of LANES rows. */
INLINE V gather(const float *from, int64_t stride, const int64_t *rows) {
    V found;
    for (int j = 0; j < LANES; j++) found[j] = from[stride * rows[j]];
    return found;
}

/* from[3 * row] of LANES rows. */
INLINE D gather_doubles(const double *from, const int64_t *rows) {
    D found;
    for (int j = 0; j < LANES; j++) found[j] = from[3 * rows[j]];
    return found;
}

#endif
