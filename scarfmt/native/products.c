/* Which products of pairs the processor at hand is for; a layer by itself, for tests and benchmarks. */

#include "products.h"

/* The fastest first. */
static const Products *const ALL[] = {
#if WIDE_PRODUCTS
    &products_avx512, &products_avxvnni, &products_avx2,
#endif
    &products_plain};
#define KINDS ((int64_t)(sizeof ALL / sizeof ALL[0]))

/* How many of the first may not be used: 0, but in tests and benchmarks. */
static int64_t passed_over = 0;

static int processor_has(const Products *kind) {
#if WIDE_PRODUCTS
    if (kind == &products_avx512) return __builtin_cpu_supports("avx512vnni") != 0;
    if (kind == &products_avxvnni) return __builtin_cpu_supports("avxvnni") != 0;
    if (kind == &products_avx2) return __builtin_cpu_supports("avx2") != 0;
#endif
    return kind == &products_plain;
}

const Products *products_at_hand(void) {
    int64_t k = passed_over < KINDS ? passed_over : KINDS - 1;
    while (!processor_has(ALL[k])) k++;
    return ALL[k];
}

/* Has the first `some` kinds of products passed over from now on; returns the name of the one that is then used. */
EXPORT const char *scar_products(int64_t some) {
    passed_over = some;
    return products_at_hand()->name;
}
