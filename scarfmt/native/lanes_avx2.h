/* Blocks in two vectors of AVX2; what products_rows.h asks for. DOT: adds the products of two vectors of pairs. */

#include <immintrin.h>

#define LANE static inline __attribute__((always_inline, TARGET))

typedef struct {
    __m256i low, high;
} Sums;
typedef Sums Pairs;

LANE Sums load_sums(const int32_t *x) {
    return (Sums){_mm256_loadu_si256((const __m256i *)x), _mm256_loadu_si256((const __m256i *)(x + 8))};
}

LANE Pairs opened(Sums words) { return words; }

LANE void store_sums(int32_t *out, Sums x) {
    _mm256_storeu_si256((__m256i *)out, x.low);
    _mm256_storeu_si256((__m256i *)(out + 8), x.high);
}

LANE Sums repeated(int32_t x) { return (Sums){_mm256_set1_epi32(x), _mm256_set1_epi32(x)}; }

LANE Sums add_pairs(Sums sums, Pairs x, const int32_t *pair) {
    const __m256i weight = _mm256_set1_epi32(*pair);
    return (Sums){DOT(sums.low, x.low, weight), DOT(sums.high, x.high, weight)};
}

/* table[place], places being 0..15. */
LANE Sums chosen(const int32_t *table, const int32_t *places) {
    const Sums all = load_sums(table), at = load_sums(places);
    const __m256i low = _mm256_slli_epi32(at.low, 28), high = _mm256_slli_epi32(at.high, 28);
    const __m256i one = _mm256_permutevar8x32_epi32(all.low, at.low), two = _mm256_permutevar8x32_epi32(all.high, at.low);
    const __m256i three = _mm256_permutevar8x32_epi32(all.low, at.high);
    const __m256i four = _mm256_permutevar8x32_epi32(all.high, at.high);
    return (Sums){
        _mm256_castps_si256(_mm256_blendv_ps(_mm256_castsi256_ps(one), _mm256_castsi256_ps(two), _mm256_castsi256_ps(low))),
        _mm256_castps_si256(
            _mm256_blendv_ps(_mm256_castsi256_ps(three), _mm256_castsi256_ps(four), _mm256_castsi256_ps(high)))};
}

LANE __m256i half_between(__m256i x, int32_t shift, int32_t low, int32_t high) {
    const __m256i shifted = _mm256_sra_epi32(x, _mm_cvtsi32_si128(shift));
    return _mm256_min_epi32(_mm256_max_epi32(shifted, _mm256_set1_epi32(low)), _mm256_set1_epi32(high));
}

LANE Sums between(Sums x, int32_t shift, int32_t low, int32_t high) {
    return (Sums){half_between(x.low, shift, low, high), half_between(x.high, shift, low, high)};
}

LANE Sums paired(Sums one, Sums other) {
    return (Sums){_mm256_blend_epi16(one.low, _mm256_slli_epi32(other.low, 16), 0xaa),
                  _mm256_blend_epi16(one.high, _mm256_slli_epi32(other.high, 16), 0xaa)};
}
