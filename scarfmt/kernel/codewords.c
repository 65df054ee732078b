/* The search for codewords: what reference_encoder/latent/rvq.py defines, of every binary32 operation the same
rounding. */

/* Without fused multiply-adds. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#else
#pragma GCC optimize("fp-contract=off")
#endif

#include "kernel.h"

/* Codewords that are scored together: as many sums as stay in registers while a vector is gone through. */
#define LANES 16
#define GROUPS 4
#define TOGETHER (GROUPS * LANES)

typedef float Scores __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t Codes __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

#define AT(pointer) (*(const Scores *)(pointer))
#define CHOSEN(mask, yes, no) (((mask) & (yes)) | (~(mask) & (no)))

static const Codes FIRST = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};

/* The least score so far of the codewords of each lane, and the first that has it. */
typedef struct {
    Scores score;
    Codes code;
} Least;

/* half + x @ words of TOGETHER codewords from `k` on, in the order of additions of reference_encoder/loops.py. */
INLINE void sums(const float *x, const Codewords *b, int64_t k, Scores *out) {
    const int64_t size = b->size, whole = b->dimension & ~(int64_t)3;
    const float *words = b->words + k;
    for (int g = 0; g < GROUPS; g++) out[g] = AT(b->half + k + g * LANES);
    for (int64_t r = 0; r < whole; r += 4, words += 4 * size)
        for (int g = 0; g < GROUPS; g++) {
            const float *w = words + g * LANES;
            out[g] += AT(w) * x[r] + AT(w + size) * x[r + 1] + (AT(w + 2 * size) * x[r + 2] + AT(w + 3 * size) * x[r + 3]);
        }
    for (int64_t r = whole; r < b->dimension; r++, words += size)
        for (int g = 0; g < GROUPS; g++) out[g] += AT(words + g * LANES) * x[r];
}

/* The code of least weight * (half + x @ words) + price, the first of equals. */
INLINE int64_t code_of(const float *x, float weight, const float *prices, const Codewords *b) {
    const Scores none = {0};
    Least least = {none + __builtin_inff(), FIRST};
    for (int64_t k = 0; k < b->size; k += TOGETHER) {
        Scores found[GROUPS];
        sums(x, b, k, found);
        for (int g = 0; g < GROUPS; g++) {
            const Scores score = found[g] * weight + AT(prices + k + g * LANES);
            const Codes less = (Codes)(score < least.score), code = FIRST + (int32_t)(k + g * LANES);
            least.score = (Scores)CHOSEN(less, (Codes)score, (Codes)least.score);
            least.code = CHOSEN(less, code, least.code);
        }
    }
    int best = 0;
    for (int j = 1; j < LANES; j++)
        if (least.score[j] < least.score[best] ||
            (least.score[j] == least.score[best] && least.code[j] < least.code[best]))
            best = j;
    return least.code[best];
}

/* (n) codes of (n, dimension) vectors of these weights and classes, by (classes, size) prices. */
WIDE EXPORT void scar_codewords(const Codewords *book, const float *x, const float *weights, const int64_t *classes,
                                const float *prices, int64_t n, int64_t *out) {
    for (int64_t i = 0; i < n; i++)
        out[i] = code_of(x + i * book->dimension, weights[i], prices + classes[i] * book->size, book);
}
