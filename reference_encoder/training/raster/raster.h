/* What the files of the rasteriser share. loading.py declares the same structs. */

#ifndef SCAR_RASTER_H
#define SCAR_RASTER_H

#include <stdint.h>

#include "../../../scarfmt/native/compiler.h"

#define TILE 16
#define GRADIENTS 9
#define UNSEEN UINT32_MAX /* key of a Gaussian that does not show: more than the bits of any positive float */

/* alpha = opacity exp(-(across (dx - slope dy)^2 + down dy^2) / 2), capped; pixels and 1/pixels^2. Furthest columns from
the mean in the row of the mean, furthest columns and rows at all. */
typedef struct {
    float across, slope, down, half_row, half_x, half_y;
} Ellipse;

typedef struct {
    float mean_x, mean_y;
    Ellipse ellipse;
    float log_opacity; /* to the base of 2 */
    float red, green, blue;
} Splat;

/* M Gaussians, in C order. */
typedef struct {
    const float *centres, *scales, *rotations, *opacities, *colours;
} Scene;

/* A camera, and rules of the image model. `widest`: pixels^2 that a unit of variance at unit depth may show as. */
typedef struct {
    double pose[12]; /* (3, 4) */
    float fx, fy, cx, cy, width, height, near, dilation, limit_x, limit_y, widest, min_alpha;
} Lens;

#endif
