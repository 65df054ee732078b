/* Sums over the anchors of each cell, and what is read from them for a block of anchors (SPEC 10.2). */

#ifndef SCAR_CELLS_H
#define SCAR_CELLS_H

#include <string.h>

#include "lanes.h"

/* Columns that a scene may average: 64 components of a channel, or those of all attributes and latents. */
#define MOST_CONTEXT_COLUMNS 512

#define FINE_LIMIT 16777216.0
#define FINE_ONE 1024.0

static const double POWERS[MOST_STEPS] = {
    1.0, 3.0, 9.0, 27.0, 81.0, 243.0, 729.0, 2187.0, 6561.0, 19683.0, 59049.0, 177147.0, 531441.0, 1594323.0,
    4782969.0, 14348907.0, 43046721.0, 129140163.0, 387420489.0, 1162261467.0};

/* 1 / (2 * 3^(steps - 1)) */
static const double HALVES[MOST_STEPS] = {
    0.5 / 1.0, 0.5 / 3.0, 0.5 / 9.0, 0.5 / 27.0, 0.5 / 81.0, 0.5 / 243.0, 0.5 / 729.0, 0.5 / 2187.0, 0.5 / 6561.0,
    0.5 / 19683.0, 0.5 / 59049.0, 0.5 / 177147.0, 0.5 / 531441.0, 0.5 / 1594323.0, 0.5 / 4782969.0, 0.5 / 14348907.0,
    0.5 / 43046721.0, 0.5 / 129140163.0, 0.5 / 387420489.0, 0.5 / 1162261467.0};

INLINE double floor_of(double x) { return __builtin_floor(x); }

INLINE int64_t power_place(int64_t steps) { return steps > MOST_STEPS ? MOST_STEPS - 1 : steps > 1 ? steps - 1 : 0; }

INLINE double power_of(int64_t steps) { return POWERS[power_place(steps)]; }

INLINE double half_of(int64_t steps) { return HALVES[power_place(steps)]; }

/* A value in 1024ths of the first cell, `power` = 3^(steps - 1), `half` = 1 / (2 power); of one that is known.

(2048 v + p) / 2p lies 1 / 2p or more from any integer, an odd number over an even one, and |v| < 2^31: the product with
the rounded inverse is less than 2^-10 / 2p away, so it has the same floor. */
INLINE double fine_of(double value, double power, double half) {
    const double scaled = floor_of((value * (2 * FINE_ONE) + power) * half);
    return scaled < -FINE_LIMIT ? -FINE_LIMIT : scaled > FINE_LIMIT ? FINE_LIMIT : scaled;
}

/* Fine values of n numbers that are at the same step. */
INLINE void fine_run(const int32_t *restrict values, int64_t n, int64_t steps, int32_t *restrict out) {
    const double power = power_of(steps), half = half_of(steps);
    if (steps > 0)
        for (int64_t i = 0; i < n; i++) out[i] = (int32_t)fine_of(values[i], power, half);
    else
        for (int64_t i = 0; i < n; i++) out[i] = 0;
}

/* 2^24 * 2^20 / 2^20: exact, and no quotient of such integers reaches the next integer by rounding. */
INLINE double mean_of(double sum, double count) { return floor_of((2 * sum + count) / (2 * count)); }

/* Means of one anchor's cells: mean[c] of each column at `depth`; where a cell is empty, `before` is kept.
Returns the count. */
INLINE double cell_means(const Cells *cells, int64_t depth, int64_t anchor, double *restrict mean) {
    const double *restrict sums = cells->sums[depth] + cells->cell[depth][anchor] * (cells->columns + 1);
    const double count = sums[cells->columns];
    if (count > 0)
        for (int64_t c = 0; c < cells->columns; c++) mean[c] = mean_of(sums[c], count);
    return count;
}

/* 32 for every binary digit of an integer, 8 digits at most. */
INLINE double count_feature(double count) {
    double digits = 0;
    for (int bit = 0; bit < 8; bit++) digits += count >= (double)(1 << bit) ? 32 : 0;
    return digits;
}

INLINE void cell_rows(const double *restrict sums, int64_t cells, int64_t columns, int32_t *restrict out) {
    for (int64_t i = 0; i < cells; i++, sums += columns + 1, out += fours(columns + 1)) {
        const double count = sums[columns], some = count > 0 ? count : 1;
        for (int64_t c = 0; c < columns; c++) out[c] = (int32_t)mean_of(sums[c], some);
        out[columns] = (int32_t)count_feature(count);
    }
}

/* Means and count features of all cells, as integers; zeros of cells that are empty. */
INLINE void fill_means(const Cells *cells) {
    for (int64_t d = 0; d < cells->depths; d++) switch (cells->columns) {
            case 1: cell_rows(cells->sums[d], cells->sizes[d], 1, cells->means[d]); break;
            case 3: cell_rows(cells->sums[d], cells->sizes[d], 3, cells->means[d]); break;
            default: cell_rows(cells->sums[d], cells->sizes[d], cells->columns, cells->means[d]);
        }
}

/* Means of a block at a depth, kept where cells are empty, and in the column after them count features; `mean` has room
for the columns and four more. */
INLINE void mean_columns(const Cells *cells, int64_t depth, const int64_t *anchors, int32_t mean[][BLOCK]) {
    const int64_t columns = cells->columns, words = fours(columns + 1);
    const int32_t *rows[BLOCK];
    int32_t four[4][BLOCK], count[BLOCK];
    for (int j = 0; j < BLOCK; j++) rows[j] = cells->means[depth] + cells->cell[depth][anchors[j]] * words;
    for (int j = 0; j < BLOCK; j++) count[j] = rows[j][columns];
    for (int64_t at = 0; at < words; at += 4) {
        four_columns(rows, at, four);
        for (int64_t c = at; c < at + 4; c++)
            for (int j = 0; j < BLOCK; j++) mean[c][j] = count[j] ? four[c - at][j] : mean[c][j];
    }
    memcpy(mean[columns], count, sizeof count);
}

/* Adds one anchor whose numbers are `stride` apart. */
INLINE void add_to_cells(const Cells *cells, int64_t anchor, const double *numbers, int64_t stride) {
    for (int64_t d = 0; d < cells->depths; d++) {
        double *sums = cells->sums[d] + cells->cell[d][anchor] * (cells->columns + 1);
        for (int64_t c = 0; c < cells->columns; c++) sums[c] += numbers[c * stride];
        sums[cells->columns] += 1;
    }
}

#define MOST_PASSES 4

/* Splits m anchors by code into passes (SPEC 10.2); returns how many there are. */
INLINE int64_t split_passes(const int64_t *chosen, int64_t m, int64_t passes_log2, int64_t *out, int64_t *ends) {
    int64_t step = (int64_t)1 << passes_log2, made = 0, passes = 0;
    for (int64_t i = 0; i < m; i += step) out[made++] = chosen[i];
    ends[passes++] = made;
    for (; step > 1; step /= 2) {
        for (int64_t i = step / 2; i < m; i += step) out[made++] = chosen[i];
        ends[passes++] = made;
    }
    return passes;
}

INLINE void empty_cells(const Cells *cells) {
    for (int64_t d = 0; d < cells->depths; d++)
        for (int64_t i = 0; i < cells->sizes[d] * (cells->columns + 1); i++) cells->sums[d][i] = 0;
}

#endif
