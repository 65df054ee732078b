/* Splats blended over the tiles of a picture, and the gradient of that, in binary32.

The image model is that of scarfmt/render/rasterise.py, whose constants come as arguments. Exponents are sums of two
squares (Splat), which float32 bears: the usual a dx dx + 2 b dx dy + c dy dy cancels in long thin splats.

Threads take tiles from a common counter. What a tile computes does not depend on the thread, and no two tiles write the
same number, so results are the same bits whatever the number of threads. No function allocates. */

#ifndef SCAR_COMPOSITE_H
#define SCAR_COMPOSITE_H

#include "raster.h"

/* Compilers that know the instructions. */
#if defined(__x86_64__) && (__GNUC__ >= 12 || __clang_major__ >= 12)
#define WIDE_TILES 1
#else
#define WIDE_TILES 0
#endif

/* Everything that a call is given; binding.py has it too. Intersections are pairs of a tile and a splat that may show
in it: numbered splat by splat, and listed tile by tile, nearest first. */
typedef struct {
    int64_t width, height, columns, tiles;
    float max_alpha, min_alpha, min_transmittance;
    float background[3];
    const Splat *splats;
    const int64_t *offsets;   /* (tiles + 1,) where the list of a tile starts */
    const int32_t *listed;    /* (intersections,) numbers */
    const int32_t *owners;    /* (intersections,) their splats */
    float *image;             /* (height, width, 3) */
    float *transmittance;     /* (height, width) what is left for the background */
    float *weights;           /* (intersections,) sums of alpha times transmittance, by number; or null */
    int32_t *drawn;           /* (tiles,) splats blended before all pixels were closed */
    const float *towards;     /* (height, width, 3) gradient of the picture */
    float *gradients;         /* (intersections, GRADIENTS), by number */
    float *measures;          /* (intersections, MEASURES), by number, of those with a weight: sums of w^2 and of w^2
                                 |c - c_behind|^2, and the largest w, for weights w, colours c and what is behind */
} Job;

/* What is done to a tile: BLEND fills image, transmittance, weights (unless null) and drawn; MEASURE weights, drawn and
measures; UNBLEND the gradients, from the picture and drawn that BLEND left. */
typedef void (*Pass)(const Job *job, int64_t tile);
enum { BLEND, MEASURE, UNBLEND, PASSES };

/* With the vectors of some processor. */
extern const Pass tiles_plain[PASSES];
#if WIDE_TILES
extern const Pass tiles_avx2[PASSES];
#endif

#endif
