/* What the files of the renderer share. binding.py declares the same structs. */

#ifndef SCAR_RASTER_H
#define SCAR_RASTER_H

#include <stdint.h>

#include "../../native/compiler.h"

#define TILE 16
#define GRADIENTS 9
#define MEASURES 3
#define BOUND_SLACK 2e-3f /* pixels by which bounds are widened, so that rounding never drops a pixel */

/* alpha = opacity exp(-(across (dx - slope dy)^2 + down dy^2) / 2), capped; pixels and 1/pixels^2. Furthest columns from
the mean in the row of the mean, furthest columns and rows at all. The opacity's logarithm to the base of 2. */
typedef struct {
    float across, slope, down, half_row, half_x, half_y, log_opacity;
} Ellipse;

typedef struct {
    float mean_x, mean_y;
    Ellipse ellipse;
    float red, green, blue;
} Splat;

/* M Gaussians, in C order. `colours` (M, 3); where there are none, spherical harmonics (M, coefficients, 3) of which
bands up to `degree` are used. */
typedef struct {
    const double *centres;
    const float *scales, *rotations, *opacities, *colours, *harmonics;
    int64_t coefficients, degree;
} Scene;

/* A camera, and rules of the image model. `antialiased`: what is widened is made fainter in return. */
typedef struct {
    double pose[12]; /* (3, 4) */
    double eye[3];
    float fx, fy, cx, cy, width, height, near, dilation, limit_x, limit_y, min_alpha, log_min_alpha;
    int32_t antialiased;
} Lens;

/* A camera as scar_nearby takes it: its pose from the origin of what it looks at. */
typedef struct {
    float pose[12]; /* (3, 4) */
    float fx, fy, cx, cy, width, height, near, dilation, limit_x, limit_y;
} Outlook;

/* Sorts entries by their upper 32 bits, which are below 2^31, the least first, equal ones as they come. Returns the one
of `entries` and `spare` that holds the result. */
uint64_t *sort_entries(uint64_t *entries, uint64_t *spare, int64_t count);

#endif
