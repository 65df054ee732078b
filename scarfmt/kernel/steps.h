/* What a tile and the steps of a channel share (SPEC 7.5, 8.4, 10.3). */

#ifndef SCAR_STEPS_H
#define SCAR_STEPS_H

#include "kernel.h"

#define CLASS_INPUTS 15
#define KINDS 256       /* contexts of a component */
#define CLASS_KINDS 16
#define VALUE_LIMIT 2147483647
#define MOST_ATTRIBUTE 6 /* components of an attribute channel */

/* Bytes of Channel.inputs for passes of up to `anchors` anchors. */
INLINE int64_t channel_inputs_bytes(int64_t settled, int64_t components, int64_t depths, int64_t anchors) {
    const int64_t width = CLASS_INPUTS + settled + components + depths * (2 * components + 1);
    return 4 * BLOCK * width * ((anchors + BLOCK - 1) / BLOCK + 1);
}

int64_t scar_positions(Rans *rans, Positions *p, const Tables *tables);
int64_t scar_channel_layer(Rans *rans, Channel *s, const ChannelLayer *l);
void scar_cells_names(const uint64_t *codes, const int64_t *by_code, int64_t n, int64_t bits, const int64_t *targets,
                      int64_t depths, int32_t *const *cell, int64_t *sizes);
void scar_fine(const int32_t *values, const int64_t *steps, int64_t n, int64_t columns, int64_t stride, int32_t *out);

#endif
