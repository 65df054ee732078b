/* From Gaussians to ellipses and back, one after the other: what projection.py does in torch, and explains. */

#include <math.h>
#include <string.h>

#include "raster.h"

#define BOUND_SLACK 2e-3f /* pixels by which bounds are widened, so that rounding never drops a pixel */
#define TINY 1.17549435e-38f

/* A projected Gaussian, as Shapes of projection.py. */
typedef struct {
    float z, slope_x, slope_y;
    float jacobian_x[3], jacobian_y[3], rotation[3][3];
    float w, x, y, zed, length;
    float turned_x[3], turned_y[3], a[3], b[3], normal[3];
    float xx, yy, determinant, across, slope, down;
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
static void to_camera(const Lens *l, const float *centre, float *local) {
    for (int k = 0; k < 3; k++) {
        const double *row = l->pose + 4 * k;
        local[k] = (float)(row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2] + row[3]);
    }
}

static void turn(const float *quaternion, Shape *s) {
    float w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    float largest = larger(larger(larger(fabsf(w), fabsf(x)), larger(fabsf(y), fabsf(z))), TINY);
    w /= largest, x /= largest, y /= largest, z /= largest;
    float length = larger(sqrtf(w * w + x * x + y * y + z * z), TINY);
    w /= length, x /= length, y /= length, z /= length;
    s->w = w, s->x = x, s->y = y, s->zed = z, s->length = largest * length;
    const float rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                  {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                  {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    memcpy(s->rotation, rotation, sizeof rotation);
}

static void find_shape(const Lens *l, const float *local, const float *scales, const float *quaternion, Shape *s) {
    s->z = local[2], s->slope_x = local[0] / local[2], s->slope_y = local[1] / local[2];
    float tx = clamped(s->slope_x, l->limit_x), ty = clamped(s->slope_y, l->limit_y);
    turn(quaternion, s);
    for (int k = 0; k < 3; k++) {
        s->jacobian_x[k] = l->fx / s->z * (float)(l->pose[k] - tx * l->pose[8 + k]);
        s->jacobian_y[k] = l->fy / s->z * (float)(l->pose[4 + k] - ty * l->pose[8 + k]);
    }
    for (int k = 0; k < 3; k++) {
        const float column[3] = {s->rotation[0][k], s->rotation[1][k], s->rotation[2][k]};
        s->turned_x[k] = dot(s->jacobian_x, column), s->turned_y[k] = dot(s->jacobian_y, column);
        s->a[k] = s->turned_x[k] * scales[k], s->b[k] = s->turned_y[k] * scales[k];
    }
    float xx = dot(s->a, s->a), xy = dot(s->a, s->b), yy = dot(s->b, s->b);
    cross(s->a, s->b, s->normal);
    s->determinant = dot(s->normal, s->normal) + l->dilation * (xx + yy) + l->dilation * l->dilation;
    s->xx = xx + l->dilation, s->yy = yy + l->dilation;
    s->across = s->yy / s->determinant, s->slope = xy / s->yy, s->down = 1 / s->yy;
}

/* Whether the centre of some pixel, of `size` in a row, lies within `half` of `mean`. */
static int touches(float mean, float half, float size) {
    float first = ceilf(mean - half - 0.5f), last = floorf(mean + half - 0.5f);
    return larger(first, 0.0f) <= (last < size - 1 ? last : size - 1);
}

/* Whether the largest circle that a Gaussian could show as may touch the picture. */
static int nearby(const Lens *l, const float *scales, float z, float reach, const float *mean) {
    float largest = larger(larger(scales[0], scales[1]), scales[2]) / z;
    float beyond_x = fabsf(mean[0] - l->width / 2) - l->width / 2, beyond_y = fabsf(mean[1] - l->height / 2) - l->height / 2;
    float beyond = larger(larger(beyond_x, beyond_y) - BOUND_SLACK, 0.0f);
    return beyond * beyond <= reach * (l->widest * largest * largest + l->dilation);
}

/* Fills an ellipse; 0 where nothing shows, and where anything is not a number. */
static int see(const Lens *l, const float *local, const float *scales, const float *quaternion, float opacity,
               const float *mean, Ellipse *e) {
    if (!(local[2] > l->near && local[2] < INFINITY && opacity >= l->min_alpha)) return 0;
    float reach = 2 * logf(opacity / l->min_alpha);
    if (!nearby(l, scales, local[2], reach, mean)) return 0;
    Shape s;
    find_shape(l, local, scales, quaternion, &s);
    if (!(s.determinant < INFINITY)) return 0;
    *e = (Ellipse){s.across, s.slope, s.down, sqrtf(reach / s.across), sqrtf(reach * s.xx) + BOUND_SLACK,
                   sqrtf(reach * s.yy) + BOUND_SLACK};
    return touches(mean[0], e->half_x, l->width) && touches(mean[1], e->half_y, l->height);
}

/* Fills means, and keys and ellipses of those that show, of Gaussians `first` to `past`. */
EXPORT void scar_project(const Scene *g, const Lens *l, int64_t first, int64_t past, float *means, uint32_t *keys,
                         Ellipse *ellipses) {
    for (int64_t i = first; i < past; i++) {
        float local[3], *mean = means + 2 * i;
        to_camera(l, g->centres + 3 * i, local);
        float z = local[2] > l->near ? local[2] : 1.0f;
        mean[0] = local[0] / z * l->fx + l->cx, mean[1] = local[1] / z * l->fy + l->cy;
        keys[i] = UNSEEN;
        if (see(l, local, g->scales + 3 * i, g->rotations + 4 * i, g->opacities[i], mean, ellipses + i))
            /* Positive floats order like their bits. */
            memcpy(keys + i, local + 2, sizeof *keys);
    }
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
