/* Products of pairs with the VNNI instructions of AVX-512. */

#include "products.h"

#if WIDE_PRODUCTS

#define TARGET target("avx512f,avx512vnni")
#define MOST_ROWS 10
#define PRODUCTS products_avx512
#define NAME "AVX-512 VNNI"
#include "lanes_avx512.h"
#include "products_rows.h"

#endif
