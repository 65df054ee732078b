/* Blocks in vectors of 16 bytes, which every processor has or the compiler takes apart; what products_rows.h asks for. */

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#define LANE static inline __attribute__((always_inline, TARGET))
#define QUARTERS (BLOCK / 4)

typedef int32_t Quarter __attribute__((vector_size(16), aligned(4), may_alias));

typedef struct {
    Quarter part[QUARTERS];
} Sums;

LANE Sums load_sums(const int32_t *x) {
    Sums out;
    for (int q = 0; q < QUARTERS; q++) out.part[q] = *(const Quarter *)(x + 4 * q);
    return out;
}

LANE void store_sums(int32_t *out, Sums x) {
    for (int q = 0; q < QUARTERS; q++) *(Quarter *)(out + 4 * q) = x.part[q];
}

LANE Sums repeated(int32_t x) {
    const Quarter every = {x, x, x, x};
    return (Sums){{every, every, every, every}};
}

/* The products of pairs, added up two by two, where there is an instruction for it. */
#if defined(__SSE2__)
#define PRODUCTS_OF_PAIRS(x, weight) _mm_madd_epi16((__m128i)(x), (__m128i)(weight))
#elif defined(__wasm_simd128__)
typedef int16_t Halves __attribute__((vector_size(16)));
#define PRODUCTS_OF_PAIRS(x, weight) __builtin_wasm_dot_s_i32x4_i16x8((Halves)(x), (Halves)(weight))
#endif

#if defined(PRODUCTS_OF_PAIRS)

typedef Sums Pairs;

LANE Pairs opened(Sums words) { return words; }

LANE Sums add_pairs(Sums sums, Pairs x, const int32_t *pair) {
    const Quarter weight = {*pair, *pair, *pair, *pair};
    for (int q = 0; q < QUARTERS; q++) sums.part[q] += (Quarter)PRODUCTS_OF_PAIRS(x.part[q], weight);
    return sums;
}

#else

typedef struct {
    Sums first, second;
} Pairs;

LANE Pairs opened(Sums words) {
    Pairs out;
    for (int q = 0; q < QUARTERS; q++) {
        out.first.part[q] = words.part[q] << 16 >> 16;
        out.second.part[q] = words.part[q] >> 16;
    }
    return out;
}

LANE Sums add_pairs(Sums sums, Pairs x, const int32_t *pair) {
    const int32_t first = (int16_t)*pair, second = *pair >> 16;
    for (int q = 0; q < QUARTERS; q++) sums.part[q] += x.first.part[q] * first + x.second.part[q] * second;
    return sums;
}

#endif

/* table[place], places being 0..15. */
LANE Sums chosen(const int32_t *table, const int32_t *places) {
    int32_t out[BLOCK];
    for (int j = 0; j < BLOCK; j++) out[j] = table[places[j]];
    return load_sums(out);
}

LANE Sums between(Sums x, int32_t shift, int32_t low, int32_t high) {
    const Sums least = repeated(low), most = repeated(high);
    for (int q = 0; q < QUARTERS; q++) {
        Quarter here = x.part[q] >> shift;
        const Quarter below = here < least.part[q], above = here > most.part[q];
        here = (here & ~below) | (least.part[q] & below);
        x.part[q] = (here & ~above) | (most.part[q] & above);
    }
    return x;
}

LANE Sums paired(Sums one, Sums other) {
    for (int q = 0; q < QUARTERS; q++) one.part[q] = (one.part[q] & 0xffff) | other.part[q] << 16;
    return one;
}
