/* Adaptive numbers (SPEC 8.5), of which the blocks of models are streams, but for HASH_GRID. */

#ifndef SCAR_NUMBERS_H
#define SCAR_NUMBERS_H

#include "model.h"

#define MOST_NUMBER_BITS 32
#define MOST_U8 255

/* The probability of a bit 0 in units of 2^-16, less one half, and the bits seen. */
typedef struct {
    int16_t lean, seen;
} BitModel;

/* All zeros: one that has seen nothing. */
typedef struct {
    BitModel prefix[MOST_NUMBER_BITS], second[MOST_NUMBER_BITS];
} NumberModel;

/* Those of a shifted array. */
typedef struct {
    NumberModel shift, values;
} ShiftedModel;

/* A block, and how many numbers the blocks of its file may still have. */
typedef struct {
    Rans rans;
    int64_t *left;
} Numbers;

Numbers open_numbers(Model *m, Body block);
void seal_numbers(const Numbers *numbers);

/* Takes n numbers, which are to be read, from those left: refuses limit-expansion. */
void spend(Numbers *numbers, int64_t n);

/* The next number, below 2^32 - 1, of some that were taken. Refuses bad-number. */
uint32_t next_number(Numbers *numbers, NumberModel *model);
int64_t next_signed(Numbers *numbers, NumberModel *model);
float next_f32(Numbers *numbers, NumberModel *model);
float float_of(uint32_t bits);

/* A number by itself, of at most `most`. Refuses limit-expansion, bad-number, count-limit. */
int64_t read_limited(Numbers *numbers, NumberModel *model, int64_t most);

/* That of a field that is read once in a block. */
int64_t read_once(Numbers *numbers, int64_t most);

/* n signed numbers times 2^shift. Refuses limit-expansion, bad-number, and `id` beyond -most..most, `most` below 2^31. */
int32_t *read_array(Numbers *numbers, NumberModel *model, Pool *pool, int64_t n, int64_t shift, int64_t most,
                    const char *id);

/* n numbers and the shift before them. Refuses limit-expansion, bad-number, count-limit. */
int32_t *read_shifted(Numbers *numbers, ShiftedModel *model, Pool *pool, int64_t n);

#endif
