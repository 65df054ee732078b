/* L1 and SSIM of a picture against a photo, with its gradient: what training looks at every iteration.

Rows are (width * 3) floats, colours side by side: a window reaches 3 floats a pixel. Work goes by rows, and the sums of a
row are its own: the same bits whatever the number of threads. */

#include <stdint.h>
#include <string.h>

#include "../../native/compiler.h"

enum { RADIUS = 5, REACH = 3 * RADIUS, MAPS = 5 };

typedef struct {
    const float *picture, *photo;            /* (height, width * 3) */
    const float *window;                     /* RADIUS + 1 weights, the middle first */
    float *by_mean, *by_square, *by_product; /* (height, width * 3), what phase 1 hands to phase 2 */
    float *gradient;                         /* (height, width * 3) */
    double *sums;                            /* (height, 2): of L1, of SSIM */
    float *scratch;                          /* (threads, 2 * MAPS * (width * 3 + 2 * REACH)) */
    int64_t height, width;
    float share, c1, c2;
} Similarity;

/* The window along a row of n floats with REACH zeros on both sides. */
INLINE void along(const float *restrict in, const float *restrict w,
                                                        float *restrict out, int64_t n) {
    for (int64_t i = 0; i < n; i++) {
        float sum = w[0] * in[i + REACH];
        for (int r = 1; r <= RADIUS; r++) sum += w[r] * (in[i + REACH - 3 * r] + in[i + REACH + 3 * r]);
        out[i] = sum;
    }
}

/* Moments of picture and photo: m and my means, s and sy of squares, p of products. */
INLINE void add_moments(const float *restrict x, const float *restrict y, float w, float *restrict m, float *restrict s,
                        float *restrict p, float *restrict my, float *restrict sy, int64_t n) {
    for (int64_t i = 0; i < n; i++) {
        float wx = w * x[i], wy = w * y[i];
        m[i] += wx;
        s[i] += wx * x[i];
        p[i] += wx * y[i];
        my[i] += wy;
        sy[i] += wy * y[i];
    }
}

INLINE void add_maps(const Similarity *t, int64_t at, float w, float *restrict m,
                                                           float *restrict s, float *restrict p, int64_t n) {
    const float *restrict a = t->by_mean + at, *restrict b = t->by_square + at, *restrict c = t->by_product + at;
    for (int64_t i = 0; i < n; i++) {
        m[i] += w * a[i];
        s[i] += w * b[i];
        p[i] += w * c[i];
    }
}

INLINE void derive(const Similarity *t, int64_t at, const float *restrict mean, const float *restrict square,
                   const float *restrict product, const float *restrict my, const float *restrict sy, int64_t n,
                   double *sums) {
    const float *restrict x = t->picture + at, *restrict y = t->photo + at;
    float *restrict by_mean = t->by_mean + at, *restrict by_square = t->by_square + at;
    float *restrict by_product = t->by_product + at;
    double l1 = 0, similar = 0;
    for (int64_t i = 0; i < n; i++) {
        float a1 = 2 * mean[i] * my[i] + t->c1, b1 = mean[i] * mean[i] + my[i] * my[i] + t->c1;
        float a2 = 2 * (product[i] - mean[i] * my[i]) + t->c2;
        float b2 = (square[i] - mean[i] * mean[i]) + (sy[i] - my[i] * my[i]) + t->c2;
        float scale = 1 / (b1 * b2), ssim = a1 * a2 * scale;
        float product_slope = 2 * a1 * scale, square_slope = -ssim / b2;
        by_product[i] = product_slope;
        by_square[i] = square_slope;
        by_mean[i] = 2 * (my[i] * a2 * scale - mean[i] * ssim / b1 - mean[i] * square_slope) - my[i] * product_slope;
        float d = x[i] - y[i];
        l1 += d < 0 ? -d : d;
        similar += ssim;
    }
    sums[0] = l1;
    sums[1] = similar;
}

INLINE void finish(const Similarity *t, int64_t at, const float *restrict m,
                                                         const float *restrict s, const float *restrict p, int64_t n) {
    const float *restrict x = t->picture + at, *restrict y = t->photo + at;
    float *restrict gradient = t->gradient + at;
    float count = (float)(t->height * n), l1 = (1 - t->share) / count, similar = t->share / count;
    for (int64_t i = 0; i < n; i++) {
        float sign = (float)(x[i] > y[i]) - (float)(x[i] < y[i]);
        gradient[i] = l1 * sign - similar * (m[i] + 2 * x[i] * s[i] + y[i] * p[i]);
    }
}

/* Rows first..past-1 of phase 1 (slopes of SSIM by its moments) or 2 (the gradient), in the scratch of one thread. */
EXPORT WIDE void scar_similarity(const Similarity *t, int64_t phase, int64_t first, int64_t past, int64_t thread) {
    int64_t n = t->width * 3, wide = n + 2 * REACH, maps = phase == 1 ? MAPS : 3;
    float *m = t->scratch + thread * 2 * MAPS * wide, *s = m + wide, *p = s + wide, *my = p + wide, *sy = my + wide;
    float *out = sy + wide;
    for (int64_t row = first; row < past; row++) {
        memset(m, 0, (size_t)(maps * wide) * sizeof(float));
        for (int64_t r = -RADIUS; r <= RADIUS; r++) {
            if (row + r < 0 || row + r >= t->height) continue;
            int64_t at = (row + r) * n;
            float w = t->window[r < 0 ? -r : r];
            if (phase == 1)
                add_moments(t->picture + at, t->photo + at, w, m + REACH, s + REACH, p + REACH, my + REACH, sy + REACH,
                            n);
            else
                add_maps(t, at, w, m + REACH, s + REACH, p + REACH, n);
        }
        for (int64_t map = 0; map < maps; map++) along(m + map * wide, t->window, out + map * wide, n);
        if (phase == 1)
            derive(t, row * n, out, out + wide, out + 2 * wide, out + 3 * wide, out + 4 * wide, n, t->sums + 2 * row);
        else
            finish(t, row * n, out, out + wide, out + 2 * wide, n);
    }
}
