/* What a tile and the steps of a channel share (SPEC 7.5, 8.4, 10.3). */

#ifndef SCAR_STEPS_H
#define SCAR_STEPS_H

#include "kernel.h"

#define KINDS 256       /* contexts of a component */
#define CLASS_KINDS 16   /* contexts of an index, a class */
#define TRIT_KINDS 5    /* contexts of a trit without a predictor */
#define VALUE_LIMIT 2147483647

INLINE int64_t pairs_of(int64_t numbers) { return (numbers + 1) / 2; }

/* Words of a row of Channel.rows, what predictors read of an anchor: its class, pairs of settled values, and its own fine
values. */
INLINE int64_t channel_row_words(int64_t settled, int64_t components) {
    return fours(1 + pairs_of(settled) + components);
}

/* Words of the inputs of an anchor, of which (words, BLOCK) lie in Channel.inputs for a block: its class, pairs that all
components share, and then those of each component. */
INLINE int64_t shared_input_words(int64_t settled, int64_t components, int64_t depths) {
    return pairs_of(settled) + pairs_of(components) + depths * pairs_of(components + 1);
}

INLINE int64_t channel_input_words(int64_t settled, int64_t components, int64_t depths) {
    return 1 + shared_input_words(settled, components, depths) + components * pairs_of(depths);
}

int64_t scar_positions(Rans *rans, Positions *p, const Tables *tables);
int64_t scar_channel_layer(Rans *rans, Channel *s, const ChannelLayer *l);
void scar_cells_names(const uint64_t *codes, const int64_t *by_code, int64_t n, int64_t bits, const int64_t *targets,
                      int64_t depths, int32_t *const *cell, int64_t *sizes);
void scar_fine(const int32_t *values, const int64_t *steps, int64_t n, int64_t columns, int64_t stride, int32_t *out);

#endif
