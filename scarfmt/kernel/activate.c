/* World positions (SPEC 9.1), and from exact values to Gaussians (SPEC 9.3-9.5): what
reference_decoder/dequantise.py and reference_decoder/explicit.py define. Activated values are computed in binary64. */

#include <math.h>
#include <string.h>

#include "structs.h"

#include "kernel.h"

/* Without fused multiply-adds: exact values are of one rounding an operation. */
#if defined(__clang__)
#define UNFUSED
#pragma STDC FP_CONTRACT OFF
#else
#define UNFUSED __attribute__((optimize("fp-contract=off")))
#endif

#define MOST_LOG_OPACITY (-0x1p-13)
#define SERIES_REACH 0.8 /* largest angle of the series of sine and cosine */

typedef double Numbers[BLOCK];

/* The numbers of a block in vectors that two registers of the smallest machine hold: compilers find wider loops by
themselves, and shuffle more than they add. */
#define QUARTERS 4
typedef double Quarter __attribute__((vector_size(8 * BLOCK / QUARTERS), aligned(8), may_alias));

/* Every third bit of a Morton code, from bit 0 on. */
INLINE uint64_t every_third(uint64_t code) {
    code &= 0x1249249249249249;
    code = (code ^ code >> 2) & 0x10C30C30C30C30C3;
    code = (code ^ code >> 4) & 0x100F00F00F00F00F;
    code = (code ^ code >> 8) & 0x001F0000FF0000FF;
    code = (code ^ code >> 16) & 0x001F00000000FFFF;
    return (code ^ code >> 32) & 0x1FFFFF;
}

/* (n, 3) world positions of (n) local codes; residuals: NULL, or planes `apart` of each other at (n) `steps`. */
UNFUSED EXPORT void scar_world_positions(const Frame *frame, const uint64_t *codes, const int32_t *residuals,
                                         int64_t apart, const int64_t *steps, int64_t n, double *out) {
    const double cell = ldexp(1, (int)frame->shift);
    for (int64_t i = 0; i < n; i++)
        for (int axis = 0; axis < 3; axis++) {
            double t = frame->corner[axis] + (double)every_third(codes[i] >> axis) * cell + cell / 2;
            if (residuals) {
                const double width = frame->widths[3 * steps[i] + axis];
                t += cell * (residuals[axis * apart + i] * width);
            }
            out[3 * i + axis] = frame->origin[axis] + frame->voxel * t;
        }
}

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

static const float NO_ROTATIONS[3 * BLOCK] = {0};

/* Unit quaternions of normals on the square and twists (SPEC 9.3). */
INLINE void quaternions(const float *rotation, int64_t some, float *out) {
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

/* Latents of a block (SPEC 9.2): sums of codewords, which binary32 holds exactly, and a value of LATENT. */
INLINE void latents(const Activation *a, int64_t i, int64_t some, Numbers *z) {
    const int64_t width = a->latent_width;
    for (int64_t j = 0; j < BLOCK; j++) {
        const int64_t anchor = i + (j < some ? j : 0), stages = a->received[anchor];
        for (int64_t c = 0; c < width; c++) {
            float sum = 0;
            for (int64_t stage = 0; stage < stages; stage++)
                sum += a->books[stage > 0][a->indices[anchor * a->stages + stage] * width + c];
            z[c][j] = a->latent ? sum + a->latent[anchor * width + c] : sum;
        }
    }
}

/* One layer of the latent decoder (SPEC 7.9). */
INLINE void apply(const Dense *layer, int rectified, Numbers *x, Numbers *y) {
    const double *weights = layer->weights;
    if (rectified)
        for (int64_t c = 0; c < layer->inputs; c++)
            for (int j = 0; j < BLOCK; j++) x[c][j] = x[c][j] > 0 ? x[c][j] : 0;
    for (int64_t r = 0; r < layer->outputs; r++, weights += layer->inputs) {
        const Quarter none = {0}, bias = none + layer->biases[r];
        Quarter a = bias, b = bias, c = bias, d = bias;
        const Quarter *in = (const Quarter *)x[0];
        for (int64_t k = 0; k < layer->inputs; k++, in += QUARTERS) {
            a += weights[k] * in[0];
            b += weights[k] * in[1];
            c += weights[k] * in[2];
            d += weights[k] * in[3];
        }
        Quarter *out = (Quarter *)y[r];
        out[0] = a, out[1] = b, out[2] = c, out[3] = d;
    }
}

/* Coefficients of a block: of degree 0 from its colour, the others from its latents (SPEC 9.4). */
INLINE void harmonics(const Activation *a, int64_t i, int64_t some, Numbers *x, Numbers *y) {
    const int64_t row = 3 * a->coefficients, outputs = a->layers ? a->layer[a->layers - 1].outputs : 0;
    if (outputs < row) /* where no decoder gives them */
        for (int64_t j = 0; j < some; j++) memset(a->harmonics + (i + j) * row, 0, 4 * (size_t)(row - outputs));
    for (int64_t j = 0; a->colour && j < some; j++) {
        const float *colour = a->colour + 3 * (i + j);
        float *out = a->harmonics + (i + j) * row;
        out[0] = colour[0] - colour[1] + colour[2];
        out[1] = colour[0] + colour[1];
        out[2] = colour[0] - colour[1] - colour[2];
    }
    if (!outputs) return;
    latents(a, i, some, x);
    for (int64_t l = 0; l < a->layers; l++) {
        apply(a->layer + l, l > 0, x, y);
        Numbers *next = x;
        x = y, y = next;
    }
    for (int64_t j = 0; j < some; j++) {
        float *out = a->harmonics + (i + j) * row + row - outputs;
        for (int64_t r = 0; r < outputs; r++) out[r] = (float)x[r][j];
    }
}

/* The Gaussians of `count` anchors; attributes that are NULL count as 0. memory: 2 * BLOCK * `widest` numbers, the most of any layer of the decoder. */
WIDE EXPORT void scar_activate(const Activation *a, double *memory) {
    Numbers *x = (Numbers *)memory, *y = x + a->widest;
    for (int64_t i = 0; i < a->count; i += BLOCK) {
        const int64_t some = a->count - i < BLOCK ? a->count - i : BLOCK;
        quaternions(a->rotation ? a->rotation + 3 * i : NO_ROTATIONS, some, a->quaternions + 4 * i);
        harmonics(a, i, some, x, y);
    }
    for (int64_t i = 0; i < a->count; i++) a->logits[i] = logit(a->opacity ? a->opacity[i] : 0);
}
