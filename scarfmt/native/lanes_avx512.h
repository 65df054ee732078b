/* Blocks in a vector of AVX-512 with VNNI; what products_rows.h asks for. */

#include <immintrin.h>

#define LANE static inline __attribute__((always_inline, TARGET))

typedef __m512i Sums;
typedef __m512i Pairs;

LANE Sums load_sums(const int32_t *x) { return _mm512_loadu_si512(x); }

LANE Pairs opened(Sums words) { return words; }

LANE void store_sums(int32_t *out, Sums x) { _mm512_storeu_si512(out, x); }

LANE Sums repeated(int32_t x) { return _mm512_set1_epi32(x); }

LANE Sums add_pairs(Sums sums, Pairs x, const int32_t *pair) {
    return _mm512_dpwssd_epi32(sums, x, _mm512_set1_epi32(*pair));
}

/* table[place], places being 0..15. */
LANE Sums chosen(const int32_t *table, const int32_t *places) {
    return _mm512_permutexvar_epi32(load_sums(places), load_sums(table));
}

LANE Sums between(Sums x, int32_t shift, int32_t low, int32_t high) {
    const __m512i shifted = _mm512_sra_epi32(x, _mm_cvtsi32_si128(shift));
    return _mm512_min_epi32(_mm512_max_epi32(shifted, _mm512_set1_epi32(low)), _mm512_set1_epi32(high));
}

LANE Sums paired(Sums one, Sums other) {
    return _mm512_or_si512(_mm512_and_si512(one, _mm512_set1_epi32(0xffff)), _mm512_slli_epi32(other, 16));
}
