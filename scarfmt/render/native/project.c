/* From Gaussians to the ellipses that a camera sees, and back: EWA projection (Zwicker et al. 2001) with the constants of
INRIA's 3D Gaussian Splatting. LANES Gaussians at a time; every number is what one after the other would give. */

#include <math.h>
#include <string.h>

#include "numbers.h"
#include "raster.h"
#include "vectors.h"

#define TINY 1.17549435e-38f

typedef double D __attribute__((vector_size(8 * LANES)));
typedef float Four __attribute__((vector_size(16)));

/* LANES Gaussians seen by a camera. */
typedef struct {
    V local[3], scales[3], quaternion[4], mean[2];
} Group;

/* Projected ones. */
typedef struct {
    V z, slope_x, slope_y;
    V jacobian_x[3], jacobian_y[3], rotation[3][3];
    V w, x, y, zed, length;
    V turned_x[3], turned_y[3], a[3], b[3], normal[3];
    V xx, yy, undilated, determinant, across, slope, down;
} Shape;

INLINE V magnitude(V a) { return (V)((M)a & INT32_MAX); }
INLINE V narrowed(D a) { return __builtin_convertvector(a, V); }
INLINE D widened(V a) { return __builtin_convertvector(a, D); }
/* Of numbers from 0 to below 2^31. */
INLINE V rounded_down(V a) { return __builtin_convertvector(__builtin_convertvector(a, M), V); }

/* from[stride * row] of LANES rows. */
INLINE V gather(const float *from, int64_t stride, const int64_t *rows) {
    V found;
    for (int j = 0; j < LANES; j++) found[j] = from[stride * rows[j]];
    return found;
}

/* from[3 * row] of LANES rows. */
INLINE D gather_doubles(const double *from, const int64_t *rows) {
    D found;
    for (int j = 0; j < LANES; j++) found[j] = from[3 * rows[j]];
    return found;
}

INLINE V dot(const V *a, const V *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross(const V *a, const V *b, V *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

INLINE V clamped(V value, float limit) {
    return where(value < -limit, all(-limit), where(value > limit, all(limit), value));
}

/* Gaussians `rows`, with the camera's axes; the mean in the picture of what is not in front of the camera is some number. */
INLINE void look_at(const Scene *s, const Lens *l, const int64_t *rows, Group *g) {
    const D x = gather_doubles(s->centres, rows), y = gather_doubles(s->centres + 1, rows),
            z = gather_doubles(s->centres + 2, rows);
    for (int k = 0; k < 3; k++) {
        const double *row = l->pose + 4 * k;
        g->local[k] = narrowed(row[0] * x + row[1] * y + row[2] * z + row[3]);
        g->scales[k] = gather(s->scales + k, 3, rows);
    }
    for (int k = 0; k < 4; k++) g->quaternion[k] = gather(s->rotations + k, 4, rows);
    V per_z = 1.0f / where(g->local[2] > l->near, g->local[2], all(1.0f));
    g->mean[0] = g->local[0] * per_z * l->fx + l->cx, g->mean[1] = g->local[1] * per_z * l->fy + l->cy;
}

INLINE void turn(const V *quaternion, Shape *s) {
    V w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    V largest = larger(larger(larger(magnitude(w), magnitude(x)), larger(magnitude(y), magnitude(z))), all(TINY));
    V per = 1.0f / largest;
    w *= per, x *= per, y *= per, z *= per;
    V length = larger(root(w * w + x * x + y * y + z * z), all(TINY));
    per = 1.0f / length;
    w *= per, x *= per, y *= per, z *= per;
    s->w = w, s->x = x, s->y = y, s->zed = z, s->length = largest * length;
    const V rotation[3][3] = {
        {1.0f - 2.0f * (y * y + z * z), 2.0f * (x * y - w * z), 2.0f * (x * z + w * y)},
        {2.0f * (x * y + w * z), 1.0f - 2.0f * (x * x + z * z), 2.0f * (y * z - w * x)},
        {2.0f * (x * z - w * y), 2.0f * (y * z + w * x), 1.0f - 2.0f * (x * x + y * y)},
    };
    memcpy(s->rotation, rotation, sizeof rotation);
}

INLINE void find_shape(const Lens *l, const Group *g, Shape *s) {
    V per_z = 1.0f / g->local[2], focal_x = l->fx * per_z, focal_y = l->fy * per_z;
    s->z = g->local[2], s->slope_x = g->local[0] * per_z, s->slope_y = g->local[1] * per_z;
    D tx = widened(clamped(s->slope_x, l->limit_x)), ty = widened(clamped(s->slope_y, l->limit_y));
    turn(g->quaternion, s);
    for (int k = 0; k < 3; k++) {
        s->jacobian_x[k] = focal_x * narrowed(l->pose[k] - tx * l->pose[8 + k]);
        s->jacobian_y[k] = focal_y * narrowed(l->pose[4 + k] - ty * l->pose[8 + k]);
    }
    for (int k = 0; k < 3; k++) {
        const V column[3] = {s->rotation[0][k], s->rotation[1][k], s->rotation[2][k]};
        s->turned_x[k] = dot(s->jacobian_x, column), s->turned_y[k] = dot(s->jacobian_y, column);
        s->a[k] = s->turned_x[k] * g->scales[k], s->b[k] = s->turned_y[k] * g->scales[k];
    }
    V xx = dot(s->a, s->a), xy = dot(s->a, s->b), yy = dot(s->b, s->b);
    cross(s->a, s->b, s->normal);
    /* |a x b|^2 is free of the cancellation of xx * yy - xy^2. */
    s->undilated = dot(s->normal, s->normal);
    s->determinant = s->undilated + l->dilation * (xx + yy) + l->dilation * l->dilation;
    s->xx = xx + l->dilation, s->yy = yy + l->dilation;
    s->down = 1.0f / s->yy, s->across = s->yy / s->determinant, s->slope = xy * s->down;
}

/* Whether the centre of some pixel, of `size` in a row, lies within `half` of `mean`. */
INLINE M touches(V mean, V half, float size) {
    V low = mean - half - 0.5f, high = mean + half - 0.5f;
    M inside = (high >= 0) & (low <= size - 1);
    /* The last at or before `high`. */
    return inside & (rounded_down(where(inside, smaller(high, all(size - 1)), all(0))) >= low);
}

/* The logarithms to the base of 2. */
INLINE V log2_of_each(V a) {
    float each[LANES];
    store(each, a);
    for (int j = 0; j < LANES; j++) each[j] = log2_of(each[j]);
    return load(each);
}

/* Fills ellipses, each LANES numbers of every member; not of those that do not show, or where anything is not a number.
Returns which do. */
INLINE M see(const Lens *l, const Group *g, V opacity, V *e) {
    V z = g->local[2];
    M seen = (z > l->near) & (z < INFINITY) & (opacity >= l->min_alpha);
    if (!signs(seen)) return seen;
    Shape s;
    find_shape(l, g, &s);
    seen &= s.determinant < INFINITY;
    if (l->antialiased) { /* Mip-Splatting (Yu et al. 2024), equation 10 */
        opacity *= root(s.undilated / s.determinant);
        seen &= opacity >= l->min_alpha;
    }
    V log_opacity = log2_of_each(opacity), reach = 1.38629436f * (log_opacity - l->log_min_alpha);
    V half_x = root(reach * s.xx) + BOUND_SLACK, half_y = root(reach * s.yy) + BOUND_SLACK;
    const V ellipses[] = {s.across, s.slope, s.down, root(reach / s.across), half_x, half_y, log_opacity};
    memcpy(e, ellipses, sizeof ellipses);
    return seen & touches(g->mean[0], half_x, l->width) & touches(g->mean[1], half_y, l->height);
}

/* Ellipse `lane` of some. */
INLINE Ellipse ellipse_of(const V *e, int lane) {
    return (Ellipse){e[0][lane], e[1][lane], e[2][lane], e[3][lane], e[4][lane], e[5][lane], e[6][lane]};
}

/* Positive floats order like their bits. */
static uint32_t key_of(float depth) {
    uint32_t key;
    memcpy(&key, &depth, sizeof key);
    return key;
}

/* Fills `rows` with LANES numbers from `first` on, the last as often as is needed. Returns how many differ. */
INLINE int fill_rows(int64_t first, int64_t past, int64_t *rows) {
    for (int j = 0; j < LANES; j++) rows[j] = first + j < past ? first + j : past - 1;
    return past - first < LANES ? (int)(past - first) : LANES;
}

/* Of spherical harmonics, INRIA's order and signs: fills what ((degree + 1)^2) coefficients count for along directions of any length. */
INLINE void harmonic_basis(V x, V y, V z, int degree, V *basis) {
    V per = 1.0f / root(x * x + y * y + z * z);
    x *= per, y *= per, z *= per;
    V xx = x * x, yy = y * y, zz = z * z;
    basis[0] = all(0.28209479f);
    if (degree > 0) {
        basis[1] = -0.48860251f * y;
        basis[2] = 0.48860251f * z;
        basis[3] = -0.48860251f * x;
    }
    if (degree > 1) {
        basis[4] = 1.09254843f * x * y;
        basis[5] = -1.09254843f * y * z;
        basis[6] = 0.31539157f * (2.0f * zz - xx - yy);
        basis[7] = -1.09254843f * x * z;
        basis[8] = 0.54627422f * (xx - yy);
    }
    if (degree > 2) {
        basis[9] = -0.59004359f * y * (3.0f * xx - yy);
        basis[10] = 2.89061144f * x * y * z;
        basis[11] = -0.4570458f * y * (4.0f * zz - xx - yy);
        basis[12] = 0.37317633f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
        basis[13] = -0.4570458f * x * (4.0f * zz - xx - yy);
        basis[14] = 1.44530572f * z * (xx - yy);
        basis[15] = -0.59004359f * x * (xx - 3.0f * yy);
    }
}

/* Fills red, green and blue from ((degree + 1)^2, 3) coefficients, by one of the directions. */
INLINE void harmonic_colour(const float *coefficients, const V *basis, int lane, int degree, float *colour) {
    int last = (degree + 1) * (degree + 1) - 1;
    const float *end = coefficients + 3 * last;
    Four sum = {0.5f, 0.5f, 0.5f, 0};
    sum += basis[last][lane] * (Four){end[0], end[1], end[2], 0};
    for (int k = 0; k < last; k++) {
        Four value; /* the fourth number is the next one's */
        memcpy(&value, coefficients + 3 * k, sizeof value);
        sum += basis[k][lane] * value;
    }
    memcpy(colour, &sum, 3 * sizeof(float));
}

/* Fills the colours of splats, of those of LANES Gaussians `rows` whose bits are set. */
INLINE void find_colours(const Scene *g, const Lens *l, const int64_t *rows, uint32_t seen, Splat *splats) {
    V basis[16], away[3];
    if (!g->colours) {
        for (int k = 0; k < 3; k++) away[k] = narrowed(gather_doubles(g->centres + k, rows) - l->eye[k]);
        harmonic_basis(away[0], away[1], away[2], (int)g->degree, basis);
    }
    for (; seen; seen &= seen - 1, splats++) {
        int j = __builtin_ctz(seen);
        if (g->colours) {
            memcpy(&splats->red, g->colours + 3 * rows[j], 3 * sizeof(float));
        } else {
            float colour[3];
            harmonic_colour(g->harmonics + 3 * g->coefficients * rows[j], basis, j, (int)g->degree, colour);
            for (int k = 0; k < 3; k++) (&splats->red)[k] = colour[k] > 0 ? colour[k] : 0;
        }
    }
}

/* Asks for the harmonics of LANES of the Gaussians `found`: from memory, they take longer than all else of a splat. */
INLINE void fetch_harmonics(const Scene *g, const int32_t *found, int64_t first, int64_t count) {
    int64_t floats = 3 * g->coefficients;
    for (int64_t k = first; k < first + LANES && k < count; k++)
        for (int64_t at = 0; at < floats; at += 16) __builtin_prefetch(g->harmonics + floats * found[k] + at);
}

/* Fills numbers, splats and entries of those of the Gaussians `found` that show. Returns how many. */
WIDE static int64_t find_splats(const Scene *g, const Lens *l, const int32_t *found, int64_t count, uint64_t *entries,
                                Splat *splats, int32_t *numbers) {
    int64_t filled = 0;
    for (int64_t k = 0; k < count; k += LANES) {
        int64_t rows[LANES];
        Group some;
        V e[7] = {0};
        int here = fill_rows(k, count, rows);
        if (!g->colours) fetch_harmonics(g, found, k + 2 * LANES, count);
        for (int j = 0; j < LANES; j++) rows[j] = found[rows[j]];
        look_at(g, l, rows, &some);
        uint32_t seen = signs(see(l, &some, gather(g->opacities, 1, rows), e)) & ((1u << here) - 1);
        if (!seen) continue;
        find_colours(g, l, rows, seen, splats + filled);
        for (; seen; seen &= seen - 1, filled++) {
            int j = __builtin_ctz(seen);
            Splat *s = splats + filled;
            s->mean_x = some.mean[0][j], s->mean_y = some.mean[1][j], s->ellipse = ellipse_of(e, j);
            numbers[filled] = (int32_t)rows[j];
            entries[filled] = (uint64_t)key_of(some.local[2][j]) << 32 | (uint64_t)filled;
        }
    }
    return filled;
}

/* Of the Gaussians `found`, rising, fills numbers of those that show; their splats, the nearest first, of equally near ones
the first; and where in `numbers` the Gaussian of a splat is. Returns how many. Every array has room for `count`. */
EXPORT int64_t scar_see(const Scene *g, const Lens *l, const int32_t *found, int64_t count, uint64_t *entries,
                        uint64_t *spare, Splat *unsorted, int32_t *numbers, Splat *splats, int32_t *order) {
    int64_t seen = find_splats(g, l, found, count, entries, unsorted, numbers);
    const uint64_t *sorted = sort_entries(entries, spare, seen);
    for (int64_t k = 0; k < seen; k++) {
        if (k + LANES < seen) __builtin_prefetch(unsorted + (sorted[k + LANES] & UINT32_MAX));
        order[k] = (int32_t)(sorted[k] & UINT32_MAX);
        splats[k] = unsorted[order[k]];
    }
    return seen;
}

INLINE void to_quaternion(const V g[3][3], const Shape *s, V *out) {
    V w = s->w, x = s->x, y = s->y, z = s->zed;
    V skew_x = g[2][1] - g[1][2], skew_y = g[0][2] - g[2][0], skew_z = g[1][0] - g[0][1];
    V both_xy = g[0][1] + g[1][0], both_xz = g[0][2] + g[2][0], both_yz = g[1][2] + g[2][1];
    V of_w = 2.0f * (x * skew_x + y * skew_y + z * skew_z);
    V of_x = 2.0f * (w * skew_x + y * both_xy + z * both_xz - 2.0f * x * (g[1][1] + g[2][2]));
    V of_y = 2.0f * (w * skew_y + x * both_xy + z * both_yz - 2.0f * y * (g[0][0] + g[2][2]));
    V of_z = 2.0f * (w * skew_z + x * both_xz + y * both_yz - 2.0f * z * (g[0][0] + g[1][1]));
    V along = of_w * w + of_x * x + of_y * y + of_z * z;
    out[0] = (of_w - along * w) / s->length, out[1] = (of_x - along * x) / s->length;
    out[2] = (of_y - along * y) / s->length, out[3] = (of_z - along * z) / s->length;
}

/* The gradients of ellipses, towards (across, slope, down), added to those of `local`; scales and rotations are filled. */
INLINE void shape_back(const Lens *l, const Shape *s, const V *scales, const V *towards, V *to_local, V *to_scales,
                       V *to_rotation) {
    V mixed = s->down * towards[1], of_e = 2.0f * s->across * s->across * towards[0];
    V of_b = 2.0f * s->down * s->down * towards[2], ridge[3], e_turned[3], to_e[3], to_b[3];
    cross(s->b, s->normal, ridge);
    V to_z = all(0);
    for (int k = 0; k < 3; k++) {
        V e = s->down * (ridge[k] + l->dilation * s->a[k]);
        e_turned[k] = e / larger(scales[k], all(TINY));
        to_e[k] = mixed * s->b[k] - of_e * e, to_b[k] = mixed * e - of_b * s->b[k];
        to_scales[k] = to_e[k] * e_turned[k] + to_b[k] * s->turned_y[k];
        to_z -= to_scales[k] * scales[k];
        to_e[k] *= scales[k], to_b[k] *= scales[k];
    }
    V matrix[3][3], to_slope_x = all(0), to_slope_y = all(0);
    for (int k = 0; k < 3; k++) {
        V e_jacobian = dot(s->rotation[k], e_turned), of_x = dot(s->rotation[k], to_e);
        for (int c = 0; c < 3; c++) matrix[k][c] = e_jacobian * to_e[c] + s->jacobian_y[k] * to_b[c];
        to_slope_x -= (float)l->pose[8 + k] * of_x;
        to_slope_y -= (float)l->pose[8 + k] * (dot(s->rotation[k], to_b) - s->slope * of_x);
    }
    V per_z = 1.0f / s->z;
    to_slope_x *= where(magnitude(s->slope_x) <= l->limit_x, l->fx * per_z * per_z, all(0));
    to_slope_y *= where(magnitude(s->slope_y) <= l->limit_y, l->fy * per_z * per_z, all(0));
    to_local[0] += to_slope_x, to_local[1] += to_slope_y;
    to_local[2] += to_z * per_z - to_slope_x * s->slope_x - to_slope_y * s->slope_y;
    to_quaternion(matrix, s, to_rotation);
}

/* Fills the gradients of centres, scales and rotations of the Gaussians of splats `first` to `past`, which `which` names, from
those of their means and of ellipses in the order of the splats. */
EXPORT WIDE void scar_project_back(const Scene *g, const Lens *l, const int64_t *which, int64_t first, int64_t past,
                                   const float *to_means, const float *to_ellipses, float *to_centres, float *to_scales,
                                   float *to_rotations) {
    for (int64_t i = first; i < past; i += LANES) {
        int64_t splats[LANES], rows[LANES];
        Group some;
        Shape s;
        V to_local[3], of_scales[3], of_rotations[4], of_shape[3], of_centres[3];
        int count = fill_rows(i, past, splats);
        for (int j = 0; j < LANES; j++) rows[j] = which[splats[j]];
        look_at(g, l, rows, &some);
        find_shape(l, &some, &s);
        for (int k = 0; k < 3; k++) of_shape[k] = gather(to_ellipses + k, 3, splats);
        to_local[0] = l->fx / s.z * gather(to_means, 2, rows), to_local[1] = l->fy / s.z * gather(to_means + 1, 2, rows);
        to_local[2] = -(to_local[0] * some.local[0] + to_local[1] * some.local[1]) / s.z;
        shape_back(l, &s, some.scales, of_shape, to_local, of_scales, of_rotations);
        for (int k = 0; k < 3; k++)
            of_centres[k] = narrowed(l->pose[k] * widened(to_local[0]) + l->pose[4 + k] * widened(to_local[1]) +
                                     l->pose[8 + k] * widened(to_local[2]));
        for (int j = 0; j < count; j++) {
            for (int k = 0; k < 3; k++) to_centres[3 * rows[j] + k] = of_centres[k][j];
            for (int k = 0; k < 3; k++) to_scales[3 * rows[j] + k] = of_scales[k][j];
            for (int k = 0; k < 4; k++) to_rotations[4 * rows[j] + k] = of_rotations[k][j];
        }
    }
}
