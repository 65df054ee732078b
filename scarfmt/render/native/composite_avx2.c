/* Tiles with AVX2. */

#include "composite.h"

#if WIDE_TILES

#define TARGET target("avx2")
#define WITH_AVX2
#define TILES tiles_avx2
#include "composite_tiles.h"

#endif
