/* Gaussians of a tile in binary32, as renderers take them (SPEC 9.3 to 9.6). */

#ifndef SCAR_GAUSSIANS_H
#define SCAR_GAUSSIANS_H

#include "exact.h"
#include "float4.h"

#define FLOATS 4 /* anchors that are worked on together */

#define MOST_LOG_OPACITY (-0x1p-13f)

/* The Gaussians of a tile of the explicit profile, and their rows in scene files. */
void activate(const Model *m, const TileState *t, Pool *pool, Gaussians *out);
void put_scene(const Model *m, const TileState *t, Pool *pool, const SceneRows *out);

/* Their parts: values of a channel, filled up so that four can be read from any anchor, NULL where there is none; unit
quaternions (n, 4); coefficients (known, coefficients, 3). */
const float *values_of(const Model *m, const TileState *t, int64_t stream, Pool *pool);
void put_rotations(const float *values, int64_t n, float *out);
void put_harmonics(const Model *m, const TileState *t, Pool *pool, float *out);

/* y = W x + b of four vectors, (columns) numbers and (stride) numbers apart. */
void apply_mlp_layer(const MlpLayer *layer, const float *x, int64_t apart, float *y);

/* A network of four vectors, `apart` of each other: rows of the stride of its last layer, in `room` of 2 * FLOATS *
mlp_width numbers. */
const float *apply_mlp(const Mlp *network, const float *x, int64_t apart, float *room);
int64_t mlp_width(const Mlp *network);

/* The Gaussians of all slots for a camera centre; `drawn`: those that are not drawn have opacity 0, and colours are
coefficients of degree 0. */
void bake_slots(const Model *m, const TileState *t, const double eye[3], int drawn, Pool *pool, Gaussians *out);

#endif
