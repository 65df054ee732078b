/* The Gaussians of anchors for a camera centre (SPEC 9.6). */

#include <string.h>

#include "gaussians.h"

#define SH_0 0.28209479177387814f
#define COVARIANCES 7

/* (v, d), or v alone without room for d. Divided by the largest number first: no square over- or underflows. */
static void look_at(const double *centre, const double eye[3], float *out, int64_t room) {
    double v[3], most = 0, squares = 0;
    for (int a = 0; a < 3; a++) {
        v[a] = centre[a] - eye[a];
        most = __builtin_fabs(v[a]) > most ? __builtin_fabs(v[a]) : most;
    }
    for (int a = 0; a < 3; a++) v[a] = most > 0 ? v[a] / most : 0, squares += v[a] * v[a];
    const double length = __builtin_sqrt(squares);
    for (int a = 0; a < 3; a++) out[a] = most > 0 ? (float)(v[a] / length) : 0;
    if (room > 3) out[3] = (float)(length * most);
}

INLINE void put_rotation(const float *q, float *out) {
    float most = 0, squares = 0, by[4];
    for (int c = 0; c < 4; c++) most = __builtin_fabsf(q[c]) > most ? __builtin_fabsf(q[c]) : most;
    for (int c = 0; c < 4; c++) by[c] = most > 0 ? q[c] / most : c == 0, squares += by[c] * by[c];
    for (int c = 0; c < 4; c++) out[c] = by[c] / __builtin_sqrtf(squares);
}

/* e^s / (1 + e^-q), whose parts may overflow where it does not. */
INLINE Float4 spread_of(Float4 s, Float4 q) { return exp4(s + least4(q, all4(0))) / (1 + exp4(-abs4(q))); }

/* An anchor: outputs of the networks, exact values, and what its first slot is in the whole. */
typedef struct {
    const float *networks[NETWORKS], *scales, *offsets;
    const double *centre;
    int64_t slot;
} Anchor;

static void put_slots(const Anchor *a, int64_t slots, Gaussians *out) {
    const float *s = a->scales;
    const Float4 near = {s[0], s[1], s[2], 0}, wide = {s[3], s[4], s[5], 0}, half = exp4(near * .5f);
    for (int64_t k = 0; k < slots; k++) {
        const int64_t at = a->slot + k;
        const float *q = a->networks[1] + COVARIANCES * k, *c = a->networks[2] + 3 * k, *offset = a->offsets + 3 * k;
        const Float4 spread = spread_of(wide, (Float4){q[0], q[1], q[2], 0});
        const Float4 colour = logistic4((Float4){c[0], c[1], c[2], 0});
        for (int i = 0; i < 3; i++) {
            out->scales[3 * at + i] = spread[i], out->harmonics[3 * at + i] = colour[i];
            out->centres[3 * at + i] = (float)(a->centre[i] + (double)(offset[i] * half[i]) * half[i]);
        }
        out->opacity[at] = tanh4(all4(a->networks[0][k]))[0];
        put_rotation(q + 3, out->quaternions + 4 * at);
    }
}

static void put_drawn(const TileState *t, Gaussians *out) {
    for (int64_t i = 0; i < out->count; i++)
        if (!t->slots[i] || !(out->opacity[i] > 0)) out->opacity[i] = 0;
    for (int64_t i = 0; i < 3 * (int64_t)out->count; i++) out->harmonics[i] = (out->harmonics[i] - .5f) / SH_0;
}

static void take_room(int64_t count, int64_t features, int64_t anchors, Pool *pool, Gaussians *out) {
    out->count = (int32_t)count, out->coefficients = 1;
    out->centres = pool_take(pool, 12 * count), out->scales = pool_take(pool, 12 * count);
    out->quaternions = pool_take(pool, 16 * count), out->opacity = pool_take(pool, 4 * count);
    out->harmonics = pool_take(pool, 12 * count), out->features = pool_take(pool, 4 * anchors * features);
}

void bake_slots(const Model *m, const TileState *t, const double eye[3], int drawn, Pool *pool, Gaussians *out) {
    const int64_t n = t->known, slots = m->slots, inputs = m->scene[0].layer[0].columns;
    const MlpLayer *last = m->decoder.layer + m->decoder.layers - 1;
    const int64_t dims = m->decoder.layer[0].columns, features = last->rows;
    const float *latents = exact_latents(m, t, pool), *scales = exact_values(m, t, channel_of(m, SCALE), pool);
    const float *offsets = exact_values(m, t, channel_of(m, OFFSETS), pool);
    const double *centres = exact_positions(m, t, pool);
    float *in = pool_zeros(pool, 4 * FLOATS * inputs), *four = pool_zeros(pool, 4 * FLOATS * dims), *rooms[NETWORKS];
    float *room = pool_take(pool, 8 * FLOATS * mlp_width(&m->decoder));
    for (int k = 0; k < NETWORKS; k++) rooms[k] = pool_take(pool, 8 * FLOATS * mlp_width(m->scene + k));
    take_room(n * slots, features, n, pool, out);
    for (int64_t i = 0; i < n; i += FLOATS) {
        const int64_t some = n - i < FLOATS ? n - i : FLOATS;
        const float *outputs[NETWORKS];
        memcpy(four, latents + i * dims, 4 * (size_t)(some * dims));
        const float *y = apply_mlp(&m->decoder, four, dims, room);
        for (int64_t j = 0; j < some; j++, y += last->stride) {
            memcpy(out->features + (i + j) * features, y, 4 * (size_t)features);
            memcpy(in + j * inputs, y, 4 * (size_t)features);
            look_at(centres + 3 * (i + j), eye, in + j * inputs + features, inputs - features);
        }
        for (int k = 0; k < NETWORKS; k++) outputs[k] = apply_mlp(m->scene + k, in, inputs, rooms[k]);
        for (int64_t j = 0; j < some; j++) {
            Anchor anchor = {.scales = scales + 6 * (i + j), .offsets = offsets + 3 * slots * (i + j),
                             .centre = centres + 3 * (i + j), .slot = (i + j) * slots};
            for (int k = 0; k < NETWORKS; k++) anchor.networks[k] = outputs[k] + j * m->scene[k].layer[1].stride;
            put_slots(&anchor, slots, out);
        }
    }
    if (drawn) put_drawn(t, out);
}
