/* Steps of the rANS decoder (SPEC 8.1, 8.2) and tables made of logits (SPEC 10.5), compiled into the loops around. */

#ifndef SCAR_RANS_H
#define SCAR_RANS_H

#include <string.h>

#include "lanes.h"

#define PRECISION 24
#define TOTAL (1u << PRECISION)
#define SLOT_MASK (TOTAL - 1)
#define EXP2_END 512

INLINE void refill(Rans *rans) {
    if (rans->state < (1ull << 32) && rans->left) rans->state = rans->state << 32 | rans->words[--rans->left];
}

INLINE void advance(Rans *rans, uint32_t slot, uint32_t first, uint32_t past) {
    rans->state = (uint64_t)(past - first) * (rans->state >> PRECISION) + slot - first;
    refill(rans);
}

/* One symbol of a table of up to three, without a branch or a look into the table: the next state of the first symbol,
and what it changes by to those of the others. */
INLINE int32_t few_symbols(Rans *rans, const FewSymbols *few) {
    const uint64_t upper = rans->state >> PRECISION, slot = rans->state & SLOT_MASK;
    const uint64_t one = -(uint64_t)(slot >= few->second), two = -(uint64_t)(slot >= few->third);
    uint64_t state = few->second * upper + slot;
    state += one & ((uint64_t)(int64_t)few->wider * upper - few->second);
    state += two & ((uint64_t)(int64_t)few->last_wider * upper - (uint64_t)few->next_first);
    rans->state = state;
    refill(rans);
    return few->values[-(int64_t)(one + two)];
}

/* One symbol of a table of more than three. */
INLINE int32_t near_symbol(Rans *rans, const StaticTable *table) {
    const uint32_t slot = (uint32_t)rans->state & SLOT_MASK, *c = table->sums;
    uint32_t symbol = table->near[slot >> table->near_shift];
    while (c[symbol + 1] <= slot) symbol++;
    advance(rans, slot, c[symbol], c[symbol + 1]);
    return table->values[symbol];
}

INLINE uint32_t edge(uint64_t sum, uint64_t spare, uint64_t total, uint32_t place) {
    return (uint32_t)(sum * spare / total) + place;
}

/* The weights of logits by how far they lie below the largest (SPEC 10.5). */
INLINE void exp2_lanes(const uint32_t *exp2, const int32_t *logits, const int32_t *most, uint32_t *restrict weights) {
    int32_t place[BLOCK];
    for (int j = 0; j < BLOCK; j++) place[j] = most[j] - logits[j] < EXP2_END ? most[j] - logits[j] : EXP2_END;
    for (int j = 0; j < BLOCK; j++) weights[j] = exp2[place[j]];
}

INLINE void raise_lanes(int32_t *restrict most, const int32_t *restrict x) {
    for (int j = 0; j < BLOCK; j++) most[j] = x[j] > most[j] ? x[j] : most[j];
}

/* The weights of (size, BLOCK) logits, and their totals. */
INLINE void column_weights(const int32_t *logits, int64_t size, const uint32_t *exp2, uint32_t *weights,
                           uint32_t *totals) {
    int32_t most[BLOCK];
    memcpy(most, logits, sizeof most);
    for (int64_t k = 1; k < size; k++) raise_lanes(most, logits + k * BLOCK);
    for (int j = 0; j < BLOCK; j++) totals[j] = 0;
    for (int64_t k = 0; k < size; k++, weights += BLOCK) {
        exp2_lanes(exp2, logits + k * BLOCK, most, weights);
        for (int j = 0; j < BLOCK; j++) totals[j] += weights[j];
    }
}

/* One symbol of the table that weights[0], weights[stride], ... make (SPEC 8.1). */
INLINE uint32_t weighted(Rans *rans, const uint32_t *weights, size_t stride, uint64_t total, uint32_t size) {
    const uint64_t spare = TOTAL - size;
    const uint32_t slot = (uint32_t)rans->state & SLOT_MASK;
    uint64_t sum = 0;
    uint32_t s = 0;
    for (; s + 1 < size; s++) {
        const uint64_t next = sum + weights[s * stride];
        /* c_(s+1) = floor(C spare / total) + s + 1 > slot, without the division. */
        if (slot < s + 1 || next * spare >= (uint64_t)(slot - s) * total) break;
        sum = next;
    }
    const uint64_t next = sum + weights[s * stride];
    advance(rans, slot, edge(sum, spare, total, s), edge(next, spare, total, s + 1));
    return s;
}

#endif
