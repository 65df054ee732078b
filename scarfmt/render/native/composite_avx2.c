/* Tiles with AVX2. */

#include "composite.h"

#if WIDE_TILES

#include <immintrin.h>

#define TARGET target("avx2")
#define TILES tiles_avx2
#include "composite_vectors.h"

PART V where(M mask, V yes, V no) { return _mm256_blendv_ps(no, yes, (V)mask); }
PART V larger(V a, V b) { return _mm256_max_ps(a, b); }
PART V smaller(V a, V b) { return _mm256_min_ps(a, b); }
PART V root(V a) { return _mm256_sqrt_ps(a); }
PART uint32_t signs(M mask) { return (uint32_t)_mm256_movemask_ps((V)mask); }

#include "composite_tiles.h"

#endif
