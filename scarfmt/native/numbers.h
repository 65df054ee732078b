/* Adaptive numbers (SPEC 8.5), of which TABLES, DECODER_MLP and SCENE_MLP blocks are streams. */

#ifndef SCAR_NUMBERS_H
#define SCAR_NUMBERS_H

#include "kernel.h"

#define MOST_NUMBER_BITS 32

/* The probability of a bit 0 in units of 2^-16, less one half, and the bits seen. */
typedef struct {
    int16_t lean, seen;
} BitModel;

/* All zeros: one that has seen nothing. */
typedef struct {
    BitModel prefix[MOST_NUMBER_BITS], second[MOST_NUMBER_BITS];
} NumberModel;

/* The next number, below 2^32 - 1. Refuses bad-number. */
uint32_t read_number(Rans *rans, NumberModel *model);
int64_t read_signed(Rans *rans, NumberModel *model);
float read_f32(Rans *rans, NumberModel *model);

/* Refuses count-limit too. */
int64_t read_limited(Rans *rans, NumberModel *model, int64_t most);

#endif
