/* Products of pairs with AVX2. */

#include "products.h"

#if WIDE_PRODUCTS

#define TARGET target("avx2")
#define MOST_ROWS 4
#define DOT(sums, x, weight) _mm256_add_epi32(sums, _mm256_madd_epi16(x, weight))
#define PRODUCTS products_avx2
#define NAME "AVX2"
#include "lanes_avx2.h"
#include "products_rows.h"

#endif
