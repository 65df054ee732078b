/* Decoded context (SPEC 10.2): what scarfmt/neural/context.py defines. */

#include "cells.h"

/* Fine values of (n, columns) `values` at (n,) `steps`, as rows of `stride` numbers. */
WIDE EXPORT void scar_fine(const int32_t *values, const int64_t *steps, int64_t n, int64_t columns, int64_t stride,
                           int32_t *out) {
    double power[BLOCK], number[BLOCK];
    for (int64_t i = 0; i < n; i += BLOCK) {
        const int64_t wide = n - i < BLOCK ? n - i : BLOCK;
        for (int64_t j = 0; j < BLOCK; j++) power[j] = power_of(steps[j < wide ? i + j : i]);
        for (int64_t c = 0; c < columns; c++) {
            for (int64_t j = 0; j < BLOCK; j++) number[j] = values[(j < wide ? i + j : i) * columns + c];
            for (int64_t j = 0; j < BLOCK; j++) number[j] = fine_of(number[j], power[j]);
            for (int64_t j = 0; j < wide; j++)
                out[(i + j) * stride + c] = steps[i + j] > 0 ? (int32_t)number[j] : 0;
        }
    }
}

/* Adds m anchors with (m, columns) integer `values`. */
EXPORT void scar_cells_add(const Cells *cells, const int64_t *anchors, int64_t m, const double *values) {
    for (int64_t i = 0; i < m; i++, values += cells->columns) add_to_cells(cells, anchors[i], values, 1);
}

/* (m, depths, columns) means around m anchors, and (m, depths) counts. */
WIDE EXPORT void scar_cells_around(const Cells *cells, const int64_t *anchors, int64_t m, double *means,
                                   double *counts) {
    const int64_t columns = cells->columns;
    for (int64_t i = 0; i < m; i++)
        for (int64_t d = 0; d < cells->depths; d++, means += columns, counts++) {
            for (int64_t c = 0; c < columns; c++) means[c] = d ? means[c - columns] : 0;
            *counts = cell_means(cells, d, anchors[i], means);
        }
}
