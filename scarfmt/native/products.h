/* Linear layers over a block of anchors, in integers (SPEC 10.1): 16-bit weights and activations are multiplied two by
two into sums of 32 bits, which hold every sum that a valid layer can reach. */

#ifndef SCAR_PRODUCTS_H
#define SCAR_PRODUCTS_H

#include "lanes.h"

#define AMAX 511        /* of predictors */
#define CLASS_STARTS 16 /* what a row starts with, by class */
#define MOST_UNITS 64

/* Compilers that know all the instructions; -DWIDE_PRODUCTS=0 leaves the plain products alone. */
#if defined(WIDE_PRODUCTS)
#elif defined(__x86_64__) && (__GNUC__ >= 12 || __clang_major__ >= 12)
#define WIDE_PRODUCTS 1
#else
#define WIDE_PRODUCTS 0
#endif

/* What the processor at hand multiplies with. */
typedef struct {
    const char *name;
    /* Context numbers of a block: (shared, BLOCK) words of inputs, (own, BLOCK) of the component alone. */
    void (*contexts)(const Predictor *p, const int32_t *shared, const int32_t *own, const int32_t *classes,
                     int32_t *context);
    /* A layer of (words, BLOCK) inputs: (rows, BLOCK) numbers, or (rows / 2, BLOCK) pairs. */
    void (*rows)(const Layer *l, const int32_t *x, int32_t *out);
    void (*pairs)(const Layer *l, const int32_t *x, int32_t *out);
} Products;

const Products *products_at_hand(void);

extern const Products products_plain;
#if WIDE_PRODUCTS
extern const Products products_avx2, products_avxvnni, products_avx512;
#endif

#endif
