/* From integers to Gaussians as scene files hold them (SPEC 9.1 to 9.4): what reference_decoder defines in NumPy, activated
values in binary64. */

#include <math.h>
#include <string.h>

#include "gaussians.h"

#define MOST_LOG_OPACITY (-0x1p-13)
#define SERIES_REACH 0.8 /* largest angle of the series of sine and cosine */

typedef double Numbers[BLOCK];

/* The numbers of a block in vectors that two registers of the smallest machine hold: compilers find wider loops by
themselves, and shuffle more than they add. */
#define QUARTERS 4
typedef double Quarter __attribute__((vector_size(8 * BLOCK / QUARTERS), aligned(8), may_alias));

/* Sine and cosine by their series, to 2e-9, and by the library where the angle is too large for them. */
INLINE void turn(const Numbers angle, Numbers sine, Numbers cosine) {
    int far = 0;
    for (int j = 0; j < BLOCK; j++) {
        const double x = angle[j], xx = x * x;
        sine[j] = x * (1 + xx * (-1. / 6 + xx * (1. / 120 + xx * (-1. / 5040 + xx * (1. / 362880)))));
        cosine[j] = 1 + xx * (-1. / 2 + xx * (1. / 24 + xx * (-1. / 720 + xx * (1. / 40320 - xx * (1. / 3628800)))));
        far |= x > SERIES_REACH || x < -SERIES_REACH;
    }
    /* Each by itself: an anchor's numbers do not depend on those beside it. */
    for (int j = 0; far && j < BLOCK; j++)
        if (angle[j] > SERIES_REACH || angle[j] < -SERIES_REACH) sine[j] = sin(angle[j]), cosine[j] = cos(angle[j]);
}

/* Unit quaternions of normals on the square and twists (SPEC 9.3). */
INLINE void put_quaternions(const float *rotation, int64_t some, float *out) {
    Numbers angle, sine, cosine, q[4];
    for (int64_t j = 0; j < BLOCK; j++) angle[j] = rotation[3 * (j < some ? j : 0) + 2] / 2.0;
    turn(angle, sine, cosine);
    for (int64_t j = 0; j < BLOCK; j++) {
        const double u = rotation[3 * (j < some ? j : 0)], v = rotation[3 * (j < some ? j : 0) + 1];
        const double px = (u + v) / 2, py = (u - v) / 2, pz = 1 - fabs(px) - fabs(py);
        const double length = sqrt(px * px + py * py + pz * pz);
        const double x = px / length, y = py / length, w = 1 + pz / length;
        const double whole = sqrt(w * w + x * x + y * y), sign = cosine[j] < 0 ? -1 / whole : 1 / whole;
        q[0][j] = w * cosine[j] * sign;
        q[1][j] = (x * sine[j] - y * cosine[j]) * sign;
        q[2][j] = (x * cosine[j] + y * sine[j]) * sign;
        q[3][j] = w * sine[j] * sign;
    }
    for (int64_t j = 0; j < some; j++)
        for (int k = 0; k < 4; k++) out[4 * j + k] = (float)q[k][j];
}

INLINE float logit(float log_opacity) {
    const double y = log_opacity < MOST_LOG_OPACITY ? log_opacity : MOST_LOG_OPACITY;
    return (float)(y - log(-expm1(y)));
}

/* One layer of DECODER_MLP (SPEC 7.9). */
INLINE void apply(const MlpLayer *layer, int rectified, Numbers *x, Numbers *y) {
    const double *weights = layer->exact;
    if (rectified)
        for (int64_t c = 0; c < layer->columns; c++)
            for (int j = 0; j < BLOCK; j++) x[c][j] = x[c][j] > 0 ? x[c][j] : 0;
    for (int64_t r = 0; r < layer->rows; r++, weights += layer->columns) {
        const Quarter none = {0}, bias = none + (double)layer->biases[r];
        Quarter a = bias, b = bias, c = bias, d = bias;
        const Quarter *in = (const Quarter *)x[0];
        for (int64_t k = 0; k < layer->columns; k++, in += QUARTERS) {
            a += weights[k] * in[0];
            b += weights[k] * in[1];
            c += weights[k] * in[2];
            d += weights[k] * in[3];
        }
        Quarter *out = (Quarter *)y[r];
        out[0] = a, out[1] = b, out[2] = c, out[3] = d;
    }
}

/* What DECODER_MLP makes of the latents of a block, at the end of rows of `row` coefficients (SPEC 9.4). */
INLINE void put_decoded(const Mlp *decoder, const float *latents, int64_t some, Numbers *x, Numbers *y, int64_t row,
                        float *out) {
    const int64_t dims = decoder->layer[0].columns, outputs = decoder->layer[decoder->layers - 1].rows;
    for (int64_t j = 0; j < BLOCK; j++)
        for (int64_t c = 0; c < dims; c++) x[c][j] = latents[(j < some ? j : 0) * dims + c];
    for (int64_t l = 0; l < decoder->layers; l++) {
        apply(decoder->layer + l, l > 0, x, y);
        Numbers *next = x;
        x = y, y = next;
    }
    for (int64_t j = 0; j < some; j++)
        for (int64_t r = 0; r < outputs; r++) out[j * row + row - outputs + r] = (float)x[r][j];
}

WIDE static void put_activated(int64_t n, const float *rotation, const float *opacity, const Mlp *decoder,
                               const float *latents, Numbers *x, int64_t widest, int64_t row, const SceneRows *out) {
    static const float none[3 * BLOCK] = {0};
    for (int64_t i = 0; i < n; i += BLOCK) {
        const int64_t some = n - i < BLOCK ? n - i : BLOCK;
        put_quaternions(rotation ? rotation + 3 * i : none, some, out->quaternions + 4 * i);
        if (latents)
            put_decoded(decoder, latents + i * decoder->layer[0].columns, some, x, x + widest, row,
                        out->harmonics + i * row);
    }
    for (int64_t i = 0; i < n; i++) out->logits[i] = logit(opacity ? opacity[i] : 0);
}

static const float *values_of(const Model *m, const TileState *t, int64_t stream, Pool *pool) {
    const int64_t channel = channel_of(m, stream);
    return channel < 0 ? NULL : exact_values(m, t, channel, pool);
}

void put_scene(const Model *m, const TileState *t, Pool *pool, const SceneRows *out) {
    const int64_t n = t->known, row = 3 * (m->sh_degree + 1) * (m->sh_degree + 1);
    const float *latents = has_decoder(m, t) ? exact_latents(m, t, pool) : NULL, *colour = values_of(m, t, COLOUR, pool);
    const float *rotation = values_of(m, t, ROTATION, pool), *opacity = values_of(m, t, OPACITY, pool);
    const MlpLayer *first = m->decoder.layer;
    int64_t widest = mlp_width(&m->decoder);
    if (latents && first->columns > widest) widest = first->columns;
    memcpy(out->positions, exact_positions(m, t, pool), 24 * (size_t)n);
    memcpy(out->log_scales, values_of(m, t, SCALE, pool), 12 * (size_t)n);
    memset(out->harmonics, 0, 4 * (size_t)(n * row));
    for (int64_t i = 0; colour && i < n; i++, colour += 3) {
        float *to = out->harmonics + i * row;
        to[0] = colour[0] - colour[1] + colour[2];
        to[1] = colour[0] + colour[1];
        to[2] = colour[0] - colour[1] - colour[2];
    }
    Numbers *x = pool_take(pool, 2 * widest * (int64_t)sizeof *x);
    put_activated(n, rotation, opacity, &m->decoder, latents, x, widest, row, out);
}
