/* Tiles with what every processor has. */

#include "composite.h"

#define TARGET unused
#define TILES tiles_plain
#include "composite_vectors.h"

PART V where(M mask, V yes, V no) { return (V)((mask & (M)yes) | (~mask & (M)no)); }
PART V larger(V a, V b) { return where(a > b, a, b); }
PART V smaller(V a, V b) { return where(a < b, a, b); }

PART V root(V a) {
    for (int i = 0; i < SPAN; i++) a[i] = __builtin_sqrtf(a[i]);
    return a;
}

PART uint32_t signs(M mask) {
    uint32_t found = 0;
    for (int i = 0; i < SPAN; i++) found |= (uint32_t)(mask[i] & 1) << i;
    return found;
}

#include "composite_tiles.h"
