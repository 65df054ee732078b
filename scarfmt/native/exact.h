/* Exact numbers of a tile after its layer (SPEC 9.1, 9.2), in memory of a pool or where they are to lie. */

#ifndef SCAR_EXACT_H
#define SCAR_EXACT_H

#include "tile.h"

/* Whether a layer decoded holds a DECODER_MLP (R-9.2-3). */
int has_decoder(const Model *m, const TileState *t);

/* (known, 3). */
void put_positions(const Model *m, const TileState *t, double *out);
const double *exact_positions(const Model *m, const TileState *t, Pool *pool);

/* (known, dims) int32 sums of codewords: S of R-9.2-2. */
const int32_t *exact_sums(const Model *m, const TileState *t, Pool *pool);

/* (known, components); of OFFSETS (known, slots, 3). */
void put_values(const Model *m, const TileState *t, int64_t channel, float *out); /* not of OFFSETS */
const float *exact_values(const Model *m, const TileState *t, int64_t channel, Pool *pool);

/* (known, dims) of a file with a DECODER_MLP. */
const float *exact_latents(const Model *m, const TileState *t, Pool *pool);

#endif
