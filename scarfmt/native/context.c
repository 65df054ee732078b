/* Decoded context (SPEC 10.2): what scarfmt/neural/context.py defines. */

#include "cells.h"
#include "steps.h"

#define MOST_BITS 21

/* Fine values of (n, columns) `values` at (n,) `steps`, as rows of `stride` numbers. */
WIDE void scar_fine(const int32_t *values, const int64_t *steps, int64_t n, int64_t columns, int64_t stride,
                           int32_t *out) {
    double power[BLOCK], half[BLOCK], number[BLOCK];
    for (int64_t i = 0; i < n; i += BLOCK) {
        const int64_t wide = n - i < BLOCK ? n - i : BLOCK;
        for (int64_t j = 0; j < BLOCK; j++) power[j] = power_of(steps[j < wide ? i + j : i]);
        for (int64_t j = 0; j < BLOCK; j++) half[j] = half_of(steps[j < wide ? i + j : i]);
        for (int64_t c = 0; c < columns; c++) {
            for (int64_t j = 0; j < BLOCK; j++) number[j] = values[(j < wide ? i + j : i) * columns + c];
            for (int64_t j = 0; j < BLOCK; j++) number[j] = fine_of(number[j], power[j], half[j]);
            for (int64_t j = 0; j < wide; j++)
                out[(i + j) * stride + c] = steps[i + j] > 0 ? (int32_t)number[j] : 0;
        }
    }
}

/* The least depth at which two codes share a cell. */
INLINE int64_t joining_depth(uint64_t one, uint64_t other) {
    const uint64_t apart = one ^ other;
    return apart ? (66 - __builtin_clzll(apart)) / 3 : 0;
}

/* For each of `depths` occupancy targets, the depth of its cells, the cell of each of n anchors of (n,) `codes`, and how
many cells there are. `by_code`: anchors by code, then index. bits: of a code on each axis, 0..21. */
void scar_cells_names(const uint64_t *codes, const int64_t *by_code, int64_t n, int64_t bits,
                             const int64_t *targets, int64_t depths, int32_t *const *cell, int64_t *sizes) {
    int64_t cells[MOST_BITS + 1] = {0};
    for (int64_t i = 1; i < n; i++) {
        const int64_t joined = joining_depth(codes[by_code[i]], codes[by_code[i - 1]]);
        cells[joined < bits ? joined : bits]++;
    }
    /* Every neighbour in code order that is joined at a depth is a cell fewer. */
    for (int64_t e = 0; e <= bits; e++) cells[e] = (e ? cells[e - 1] : n) - cells[e];
    for (int64_t d = 0; d < depths; d++) {
        int64_t depth = 0, name = 0;
        for (int64_t e = 0; e <= bits; e++) depth += cells[e] * targets[d] > n;
        depth = depth < bits ? depth : bits;
        for (int64_t i = 0; i < n; i++) {
            name += i && joining_depth(codes[by_code[i]], codes[by_code[i - 1]]) > depth;
            cell[d][by_code[i]] = (int32_t)name;
        }
        sizes[d] = n ? name + 1 : 0;
    }
}
