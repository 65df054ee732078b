/* A scene made ready to be drawn, and which of its Gaussians may touch a picture: what a view goes through first. */

#include <float.h>
#include <math.h>

#include "numbers.h"
#include "raster.h"

#define BLOCK 512
/* Sums of three products in binary32, and what they are made of, are off by less, relative to the sum of magnitudes. */
#define ROUNDING 1e-6f
/* Nearer, in units of that error, a Gaussian may lie anywhere. */
#define DOUBTFUL 64
/* Bounds are so much larger than what they bound: that covers what the depth is off by. */
#define GENEROUS 1.1f

/* Fills scales and opacities (M,), and the (5, M) `outline`: places from an origin, the variance of the longest axis, and
how far the ellipse reaches, deviations^2, negative where nothing ever shows. */
EXPORT void scar_prepare(const double *positions, const float *log_scales, const float *logits, const double *origin,
                         int64_t count, float min_alpha, float *scales, float *opacities, float *outline) {
    float log_min_alpha = log2_of(min_alpha);
    for (int64_t i = 0; i < count; i++) {
        float largest = 0;
        for (int k = 0; k < 3; k++) {
            float scale = scales[3 * i + k] = (float)exp_of(log_scales[3 * i + k]);
            largest = scale > largest ? scale : largest;
            outline[k * count + i] = (float)(positions[3 * i + k] - origin[k]);
        }
        float opacity = opacities[i] = (float)(1 / (1 + exp_of(-(double)logits[i])));
        outline[3 * count + i] = largest * largest;
        outline[4 * count + i] = opacity >= min_alpha ? reach_of(log2_of(opacity), log_min_alpha) : -1;
    }
}

/* A NaN is the least. */
INLINE float between(float value, float least, float most) {
    value = value > least ? value : least;
    return value < most ? value : most;
}

/* Squared distance from the next pixel centre of the picture, pixels, less what rounding may have added. Samples of a
sparse picture lie between most splats. */
INLINE float beyond(float centre, float size, float slack) {
    float nearest = (float)(int32_t)between(centre, 0, size - 1) + 0.5f;
    float apart = fabsf(centre - nearest) - slack;
    apart = apart > 0 ? apart : 0;
    return apart * apart;
}

/* Fills `near` with 1 for those that may touch the picture, and 0. A NaN is not near. */
WIDE static void mark(const Outlook *o, const float *outline, int64_t count, int64_t first, int past, int32_t *near) {
    const float *px = outline + first, *py = px + count, *pz = py + count, *variances = pz + count,
                *reaches = variances + count, *m = o->pose;
    float still = ROUNDING * (fabsf(m[3]) + fabsf(m[7]) + fabsf(m[11]));
    for (int i = 0; i < past; i++) {
        float x = px[i], y = py[i], z = pz[i];
        float error = still + ROUNDING * (fabsf(x) + fabsf(y) + fabsf(z));
        float depth = m[8] * x + m[9] * y + m[10] * z + m[11], per_depth = 1 / depth;
        float across = (m[0] * x + m[1] * y + m[2] * z + m[3]) * per_depth;
        float down = (m[4] * x + m[5] * y + m[6] * z + m[7]) * per_depth;
        float slope_x = between(across, -o->limit_x, o->limit_x), slope_y = between(down, -o->limit_y, o->limit_y);
        float focal_x = o->fx * per_depth, focal_y = o->fy * per_depth, reach = GENEROUS * reaches[i];
        float wide = reach * (focal_x * focal_x * (1 + slope_x * slope_x) * variances[i] + o->dilation);
        float high = reach * (focal_y * focal_y * (1 + slope_y * slope_y) * variances[i] + o->dilation);
        float slack_x = 2 * BOUND_SLACK + 2 * error * focal_x * (1 + fabsf(across));
        float slack_y = 2 * BOUND_SLACK + 2 * error * focal_y * (1 + fabsf(down));
        int32_t touches = !(beyond(o->fx * across + o->cx, o->width, slack_x) > wide) &
                          !(beyond(o->fy * down + o->cy, o->height, slack_y) > high);
        int32_t doubtful = !(depth > DOUBTFUL * error);
        near[i] = (depth + error > o->near) & (depth <= FLT_MAX) & (reaches[i] >= 0) & (touches | doubtful);
    }
}

/* Fills `found` with the numbers of those that may touch the picture, rising; how many. */
EXPORT int64_t scar_nearby(const Outlook *o, const float *outline, int64_t count, int32_t *found) {
    int64_t filled = 0;
    for (int64_t first = 0; first < count; first += BLOCK) {
        int32_t near[BLOCK];
        int past = count - first < BLOCK ? (int)(count - first) : BLOCK;
        mark(o, outline, count, first, past, near);
        for (int i = 0; i < past; i++) {
            found[filled] = (int32_t)(first + i);
            filled += near[i];
        }
    }
    return filled;
}
