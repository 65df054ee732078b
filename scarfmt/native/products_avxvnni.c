/* Products of pairs with the VNNI instructions of AVX2. */

#include "products.h"

#if WIDE_PRODUCTS

#define TARGET target("avx2,avxvnni")
#define MOST_ROWS 4
#define DOT(sums, x, weight) _mm256_dpwssd_avx_epi32(sums, x, weight)
#define PRODUCTS products_avxvnni
#define NAME "AVX-VNNI"
#include "lanes_avx2.h"
#include "products_rows.h"

#endif
