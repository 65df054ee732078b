/* What benchmarks/integer_peak.py measures products against: the machine's peaks, and float32 rows as the kernel had them
before decision 0032. Each function returns nanoseconds of processor time. */

#include <stdint.h>
#include <time.h>

#define BLOCK 16
#define ROWS 5

typedef float Lanes __attribute__((vector_size(4 * BLOCK), aligned(4), may_alias));

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

#if defined(__x86_64__)
#include <immintrin.h>

#define EACH(step) step(0) step(1) step(2) step(3) step(4) step(5) step(6) step(7) step(8) step(9)

/* `rounds` times 10 products of 16 numbers, added by pairs to sums. Operands pass through registers that the compiler
cannot see into, or it would multiply once. */
__attribute__((target("avx2"))) double integer_peak(int64_t rounds) {
#define NONE(k) __m256i sum##k = _mm256_setzero_si256();
#define ADD(k)                                                        \
    __asm__ volatile("" : "+x"(x));                                   \
    sum##k = _mm256_add_epi32(sum##k, _mm256_madd_epi16(x, x));
#define KEEP(k) __asm__ volatile("" : : "x"(sum##k));
    EACH(NONE)
    __m256i x = _mm256_set1_epi16(3);
    const double start = now();
    for (int64_t i = 0; i < rounds; i++) { EACH(ADD) }
    EACH(KEEP)
    return now() - start;
#undef NONE
#undef ADD
}

/* `rounds` times 10 products of 8 numbers, each added to a sum. */
__attribute__((target("avx2,fma"))) double float_peak(int64_t rounds) {
#define NONE(k) __m256 sum##k = _mm256_setzero_ps();
#define ADD(k)                                \
    __asm__ volatile("" : "+x"(x));           \
    sum##k = _mm256_fmadd_ps(x, x, sum##k);
    EACH(NONE)
    __m256 x = _mm256_set1_ps(0.5f);
    const double start = now();
    for (int64_t i = 0; i < rounds; i++) { EACH(ADD) }
    EACH(KEEP)
    return now() - start;
}

int has_peaks(void) { return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"); }

#define WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
double integer_peak(int64_t rounds) { return (double)rounds; }
double float_peak(int64_t rounds) { return (double)rounds; }
int has_peaks(void) { return 0; }
#define WIDE
#endif

static inline __attribute__((always_inline)) void add_products(const float *weights, int64_t stride, const float *x,
                                                               int64_t n, Lanes out[ROWS]) {
    const Lanes *input = (const Lanes *)x;
    Lanes a = out[0], b = out[1], c = out[2], d = out[3], e = out[4];
    for (int64_t k = 0; k < n; k++, weights++) {
        a += weights[0] * input[k];
        b += weights[stride] * input[k];
        c += weights[2 * stride] * input[k];
        d += weights[3 * stride] * input[k];
        e += weights[4 * stride] * input[k];
    }
    out[0] = a, out[1] = b, out[2] = c, out[3] = d, out[4] = e;
}

/* `times` times (blocks, inputs, BLOCK) to (rows, BLOCK) numbers; rows are filled up to a multiple of ROWS. */
WIDE double float_rows(const float *weights, int64_t rows, int64_t inputs, const float *x, int64_t blocks,
                       int64_t times, float *out) {
    const double start = now();
    for (int64_t t = 0; t < times; t++)
        for (int64_t b = 0; b < blocks; b++)
            for (int64_t row = 0; row < rows; row += ROWS) {
                Lanes sums[ROWS] = {{0}, {0}, {0}, {0}, {0}};
                add_products(weights + row * inputs, inputs, x + b * inputs * BLOCK, inputs, sums);
                for (int64_t r = 0; r < ROWS; r++) ((Lanes *)out)[row + r] = sums[r];
            }
    return now() - start;
}
