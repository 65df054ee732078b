/* From Gaussians to the ellipses that a camera sees, and back: EWA projection (Zwicker et al. 2001) with the constants of
INRIA's 3D Gaussian Splatting. One Gaussian after the other. */

#include <math.h>
#include <string.h>

#include "harmonics.h"
#include "numbers.h"
#include "raster.h"

#define TINY 1.17549435e-38f
#define AHEAD 8 /* Gaussians that are asked for early */

/* A projected Gaussian. */
typedef struct {
    float z, slope_x, slope_y;
    float jacobian_x[3], jacobian_y[3], rotation[3][3];
    float w, x, y, zed, length;
    float turned_x[3], turned_y[3], a[3], b[3], normal[3];
    float xx, yy, undilated, determinant, across, slope, down;
} Shape;

static float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const float *a, const float *b, float *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static float clamped(float value, float limit) { return value < -limit ? -limit : value > limit ? limit : value; }
static float larger(float a, float b) { return a > b ? a : b; }

/* The position with the camera's axes. */
static void to_camera(const Lens *l, const double *centre, float *local) {
    for (int k = 0; k < 3; k++) {
        const double *row = l->pose + 4 * k;
        local[k] = (float)(row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2] + row[3]);
    }
}

static void turn(const float *quaternion, Shape *s) {
    float w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    float largest = larger(larger(larger(fabsf(w), fabsf(x)), larger(fabsf(y), fabsf(z))), TINY);
    float per = 1 / largest;
    w *= per, x *= per, y *= per, z *= per;
    float length = larger(sqrtf(w * w + x * x + y * y + z * z), TINY);
    per = 1 / length;
    w *= per, x *= per, y *= per, z *= per;
    s->w = w, s->x = x, s->y = y, s->zed = z, s->length = largest * length;
    const float rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                  {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                  {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    memcpy(s->rotation, rotation, sizeof rotation);
}

static void find_shape(const Lens *l, const float *local, const float *scales, const float *quaternion, Shape *s) {
    float per_z = 1 / local[2], focal_x = l->fx * per_z, focal_y = l->fy * per_z;
    s->z = local[2], s->slope_x = local[0] * per_z, s->slope_y = local[1] * per_z;
    float tx = clamped(s->slope_x, l->limit_x), ty = clamped(s->slope_y, l->limit_y);
    turn(quaternion, s);
    for (int k = 0; k < 3; k++) {
        s->jacobian_x[k] = focal_x * (float)(l->pose[k] - tx * l->pose[8 + k]);
        s->jacobian_y[k] = focal_y * (float)(l->pose[4 + k] - ty * l->pose[8 + k]);
    }
    for (int k = 0; k < 3; k++) {
        const float column[3] = {s->rotation[0][k], s->rotation[1][k], s->rotation[2][k]};
        s->turned_x[k] = dot(s->jacobian_x, column), s->turned_y[k] = dot(s->jacobian_y, column);
        s->a[k] = s->turned_x[k] * scales[k], s->b[k] = s->turned_y[k] * scales[k];
    }
    float xx = dot(s->a, s->a), xy = dot(s->a, s->b), yy = dot(s->b, s->b);
    cross(s->a, s->b, s->normal);
    /* |a x b|^2 is free of the cancellation of xx * yy - xy^2. */
    s->undilated = dot(s->normal, s->normal);
    s->determinant = s->undilated + l->dilation * (xx + yy) + l->dilation * l->dilation;
    s->xx = xx + l->dilation, s->yy = yy + l->dilation;
    s->down = 1 / s->yy, s->across = s->yy / s->determinant, s->slope = xy * s->down;
}

/* Whether the centre of some pixel, of `size` in a row, lies within `half` of `mean`. */
static int touches(float mean, float half, float size) {
    float low = mean - half - 0.5f, high = mean + half - 0.5f;
    if (!(high >= 0 && low <= size - 1)) return 0;
    /* The last at or before `high`. */
    return (float)(int32_t)(high < size - 1 ? high : size - 1) >= low;
}

/* Whether no ellipse of a Gaussian touches the picture along one axis: size pixels, the variance of its longest axis. */
static int misses(float mean, float slope, float limit, float focal, float size, float variance, float reach,
                  float dilation) {
    float tangent = clamped(slope, limit), beyond = fabsf(mean - size / 2) - size / 2 - BOUND_SLACK;
    return beyond > 0 && beyond * beyond > 1.0001f * reach * (focal * focal * (1 + tangent * tangent) * variance + dilation);
}

/* Fills an ellipse; 0 where nothing shows, and where anything is not a number. */
static int see(const Lens *l, const float *local, const float *scales, const float *quaternion, float opacity,
               const float *mean, Ellipse *e) {
    if (!(local[2] > l->near && local[2] < INFINITY && opacity >= l->min_alpha)) return 0;
    float log_opacity = log2_of(opacity), reach = reach_of(log_opacity, l->log_min_alpha), per_z = 1 / local[2];
    float largest = larger(larger(scales[0], scales[1]), scales[2]), variance = largest * largest;
    if (misses(mean[0], local[0] * per_z, l->limit_x, l->fx * per_z, l->width, variance, reach, l->dilation) ||
        misses(mean[1], local[1] * per_z, l->limit_y, l->fy * per_z, l->height, variance, reach, l->dilation))
        return 0;
    Shape s;
    find_shape(l, local, scales, quaternion, &s);
    if (!(s.determinant < INFINITY)) return 0;
    if (l->antialiased) { /* Mip-Splatting (Yu et al. 2024), equation 10 */
        opacity *= sqrtf(s.undilated / s.determinant);
        if (!(opacity >= l->min_alpha)) return 0;
        log_opacity = log2_of(opacity), reach = reach_of(log_opacity, l->log_min_alpha);
    }
    float half_x = sqrtf(reach * s.xx) + BOUND_SLACK, half_y = sqrtf(reach * s.yy) + BOUND_SLACK;
    if (!touches(mean[0], half_x, l->width) || !touches(mean[1], half_y, l->height)) return 0;
    *e = (Ellipse){s.across, s.slope, s.down, sqrtf(reach / s.across), half_x, half_y, log_opacity};
    return 1;
}

/* The mean in the picture; of what is not in front of the camera, some number. */
static void find_mean(const Lens *l, const float *local, float *mean) {
    float per_z = 1 / (local[2] > l->near ? local[2] : 1.0f);
    mean[0] = local[0] * per_z * l->fx + l->cx, mean[1] = local[1] * per_z * l->fy + l->cy;
}

/* Positive floats order like their bits. */
static uint32_t key_of(float depth) {
    uint32_t key;
    memcpy(&key, &depth, sizeof key);
    return key;
}

/* Fills means, and keys and ellipses of those that show, of Gaussians `first` to `past`. */
EXPORT void scar_project(const Scene *g, const Lens *l, int64_t first, int64_t past, float *means, uint32_t *keys,
                         Ellipse *ellipses) {
    for (int64_t i = first; i < past; i++) {
        float local[3], *mean = means + 2 * i;
        to_camera(l, g->centres + 3 * i, local);
        find_mean(l, local, mean);
        int seen = see(l, local, g->scales + 3 * i, g->rotations + 4 * i, g->opacities[i], mean, ellipses + i);
        keys[i] = seen ? key_of(local[2]) : UNSEEN;
    }
}

static void find_colour(const Scene *g, const Lens *l, int64_t i, Splat *s) {
    if (g->colours) {
        const float *colour = g->colours + 3 * i;
        s->red = colour[0], s->green = colour[1], s->blue = colour[2];
        return;
    }
    double away[3];
    for (int k = 0; k < 3; k++) away[k] = g->centres[3 * i + k] - l->eye[k];
    float colour[3];
    harmonic_colour(g->harmonics + 3 * g->coefficients * i, away, (int)g->degree, colour);
    s->red = larger(colour[0], 0.0f), s->green = larger(colour[1], 0.0f), s->blue = larger(colour[2], 0.0f);
}

static void prefetch(const Scene *g, int64_t i) {
    __builtin_prefetch(g->centres + 3 * i);
    __builtin_prefetch(g->scales + 3 * i);
    __builtin_prefetch(g->rotations + 4 * i);
    if (!g->colours)
        for (int64_t k = 0; k < 3 * g->coefficients; k += 16) __builtin_prefetch(g->harmonics + 3 * g->coefficients * i + k);
}

/* Of the Gaussians `found`, rising, fills numbers of those that show; their splats, the nearest first, of equally near ones
the first; and where in `numbers` the Gaussian of a splat is. Returns how many. Every array has room for `count`. */
EXPORT int64_t scar_see(const Scene *g, const Lens *l, const int32_t *found, int64_t count, uint64_t *entries,
                        uint64_t *spare, Splat *unsorted, int32_t *numbers, Splat *splats, int32_t *order) {
    int64_t seen = 0;
    for (int64_t k = 0; k < count; k++) {
        int64_t i = found[k];
        if (k + AHEAD < count) prefetch(g, found[k + AHEAD]);
        float local[3], mean[2];
        Splat *s = unsorted + seen;
        to_camera(l, g->centres + 3 * i, local);
        find_mean(l, local, mean);
        if (!see(l, local, g->scales + 3 * i, g->rotations + 4 * i, g->opacities[i], mean, &s->ellipse)) continue;
        s->mean_x = mean[0], s->mean_y = mean[1];
        find_colour(g, l, i, s);
        numbers[seen] = (int32_t)i;
        entries[seen] = (uint64_t)key_of(local[2]) << 32 | (uint64_t)seen;
        seen++;
    }
    const uint64_t *sorted = sort_entries(entries, spare, seen);
    for (int64_t k = 0; k < seen; k++) {
        if (k + AHEAD < seen) __builtin_prefetch(unsorted + (sorted[k + AHEAD] & UINT32_MAX));
        order[k] = (int32_t)(sorted[k] & UINT32_MAX);
        splats[k] = unsorted[order[k]];
    }
    return seen;
}

static void to_quaternion(const float g[3][3], const Shape *s, float *out) {
    float w = s->w, x = s->x, y = s->y, z = s->zed;
    float skew_x = g[2][1] - g[1][2], skew_y = g[0][2] - g[2][0], skew_z = g[1][0] - g[0][1];
    float both_xy = g[0][1] + g[1][0], both_xz = g[0][2] + g[2][0], both_yz = g[1][2] + g[2][1];
    float of_w = 2 * (x * skew_x + y * skew_y + z * skew_z);
    float of_x = 2 * (w * skew_x + y * both_xy + z * both_xz - 2 * x * (g[1][1] + g[2][2]));
    float of_y = 2 * (w * skew_y + x * both_xy + z * both_yz - 2 * y * (g[0][0] + g[2][2]));
    float of_z = 2 * (w * skew_z + x * both_xz + y * both_yz - 2 * z * (g[0][0] + g[1][1]));
    float along = of_w * w + of_x * x + of_y * y + of_z * z;
    out[0] = (of_w - along * w) / s->length, out[1] = (of_x - along * x) / s->length;
    out[2] = (of_y - along * y) / s->length, out[3] = (of_z - along * z) / s->length;
}

/* The gradient of an ellipse, towards (across, slope, down), added to that of `local`; scales and rotation are filled. */
static void shape_back(const Lens *l, const Shape *s, const float *scales, const float *towards, float *to_local,
                       float *to_scales, float *to_rotation) {
    float mixed = s->down * towards[1], of_e = 2 * s->across * s->across * towards[0];
    float of_b = 2 * s->down * s->down * towards[2], ridge[3], e_turned[3], to_e[3], to_b[3];
    cross(s->b, s->normal, ridge);
    float to_z = 0.0f;
    for (int k = 0; k < 3; k++) {
        float e = s->down * (ridge[k] + l->dilation * s->a[k]);
        e_turned[k] = e / larger(scales[k], TINY);
        to_e[k] = mixed * s->b[k] - of_e * e, to_b[k] = mixed * e - of_b * s->b[k];
        to_scales[k] = to_e[k] * e_turned[k] + to_b[k] * s->turned_y[k];
        to_z -= to_scales[k] * scales[k];
        to_e[k] *= scales[k], to_b[k] *= scales[k];
    }
    float matrix[3][3], to_slope_x = 0.0f, to_slope_y = 0.0f;
    for (int k = 0; k < 3; k++) {
        float e_jacobian = dot(s->rotation[k], e_turned), of_x = dot(s->rotation[k], to_e);
        for (int c = 0; c < 3; c++) matrix[k][c] = e_jacobian * to_e[c] + s->jacobian_y[k] * to_b[c];
        to_slope_x -= (float)l->pose[8 + k] * of_x;
        to_slope_y -= (float)l->pose[8 + k] * (dot(s->rotation[k], to_b) - s->slope * of_x);
    }
    float per_z = 1.0f / s->z;
    to_slope_x *= fabsf(s->slope_x) <= l->limit_x ? l->fx * per_z * per_z : 0.0f;
    to_slope_y *= fabsf(s->slope_y) <= l->limit_y ? l->fy * per_z * per_z : 0.0f;
    to_local[0] += to_slope_x, to_local[1] += to_slope_y;
    to_local[2] += to_z * per_z - to_slope_x * s->slope_x - to_slope_y * s->slope_y;
    to_quaternion(matrix, s, to_rotation);
}

static void mean_back(const Lens *l, const float *local, const float *towards, float *to_local) {
    if (!(local[2] > l->near)) {
        to_local[0] = l->fx * towards[0], to_local[1] = l->fy * towards[1], to_local[2] = 0.0f;
        return;
    }
    to_local[0] = l->fx / local[2] * towards[0], to_local[1] = l->fy / local[2] * towards[1];
    to_local[2] = -(to_local[0] * local[0] + to_local[1] * local[1]) / local[2];
}

/* Fills the gradients of centres, scales and rotations of Gaussians `first` to `past` from those of means and of the
ellipses, whose rows `places` gives (-1 where a Gaussian does not show). */
EXPORT void scar_project_back(const Scene *g, const Lens *l, int64_t first, int64_t past, const int32_t *places,
                              const float *to_means, const float *to_ellipses, float *to_centres, float *to_scales,
                              float *to_rotations) {
    memset(to_scales + 3 * first, 0, sizeof(float) * 3 * (past - first));
    memset(to_rotations + 4 * first, 0, sizeof(float) * 4 * (past - first));
    for (int64_t i = first; i < past; i++) {
        float local[3], to_local[3];
        to_camera(l, g->centres + 3 * i, local);
        mean_back(l, local, to_means + 2 * i, to_local);
        if (places[i] >= 0) {
            Shape s;
            find_shape(l, local, g->scales + 3 * i, g->rotations + 4 * i, &s);
            shape_back(l, &s, g->scales + 3 * i, to_ellipses + 3 * places[i], to_local, to_scales + 3 * i,
                       to_rotations + 4 * i);
        }
        for (int k = 0; k < 3; k++)
            to_centres[3 * i + k] = (float)(l->pose[k] * to_local[0] + l->pose[4 + k] * to_local[1] +
                                            l->pose[8 + k] * to_local[2]);
    }
}
