/* Vectors of LANES numbers in binary32: Gaussians side by side, or pixels of a row. Of each the same operations in the same
order as on its own.

A file that is compiled for processors with AVX2 defines TARGET so, the attribute of its functions, and WITH_AVX2. */

#ifndef SCAR_VECTORS_H
#define SCAR_VECTORS_H

#include <stdint.h>
#include <string.h>

#include "../../native/compiler.h"

#ifndef TARGET
#define TARGET unused
#endif
#define PART INLINE __attribute__((TARGET))

#define LANES 8
typedef float V __attribute__((vector_size(4 * LANES)));
typedef int32_t M __attribute__((vector_size(4 * LANES)));

PART V load(const float *from) {
    V value;
    memcpy(&value, from, sizeof value);
    return value;
}

PART void store(float *to, V value) { memcpy(to, &value, sizeof value); }
PART V all(float value) { return value - (V){0}; }

/* where: one or the other, by a mask of all bits or none; signs: a bit for each that is set, that of the first lowest. */
#ifdef WITH_AVX2

#include <immintrin.h>

PART V where(M mask, V yes, V no) { return _mm256_blendv_ps(no, yes, (V)mask); }
PART V larger(V a, V b) { return _mm256_max_ps(a, b); }
PART V smaller(V a, V b) { return _mm256_min_ps(a, b); }
PART V root(V a) { return _mm256_sqrt_ps(a); }
PART uint32_t signs(M mask) { return (uint32_t)_mm256_movemask_ps((V)mask); }

#else

PART V where(M mask, V yes, V no) { return (V)((mask & (M)yes) | (~mask & (M)no)); }
PART V larger(V a, V b) { return where(a > b, a, b); }
PART V smaller(V a, V b) { return where(a < b, a, b); }

PART V root(V a) {
    float each[LANES];
    store(each, a);
    for (int j = 0; j < LANES; j++) each[j] = __builtin_sqrtf(each[j]);
    return load(each);
}

PART uint32_t signs(M mask) {
    uint32_t found = 0;
    for (int j = 0; j < LANES; j++) found |= (uint32_t)(mask[j] & 1) << j;
    return found;
}

#endif

#endif
