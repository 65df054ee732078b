/* What the kernel's files share. Compiled by GCC or Clang as a plain library: no Python header is needed, ctypes
calls it.

Exact arithmetic throughout: the same numbers come from Python where this was not compiled, and tests compare them. No
function allocates. What indexes an array comes from other arrays that the caller made, never unchecked from a file. */

#include <stddef.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))

/* Grows with every change of a function's arguments or of a struct: interface.py loads no other. */
#define INTERFACE 1

/* Wider vectors where the machine has them, chosen when the library is loaded: glibc can, musl cannot. */
#if defined(__x86_64__) && defined(__GLIBC__) && __GNUC__ >= 12 && !defined(__clang__)
#define WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define WIDE
#endif

/* Compiled anew in each caller, for the vectors that it uses. */
#define INLINE static inline __attribute__((always_inline))

/* One number of each of BLOCK anchors. */
#define BLOCK 16
typedef float Lanes __attribute__((vector_size(4 * BLOCK), aligned(4)));

/* A decoder's state and its words, of which the last is taken first (SPEC 8.2). */
typedef struct {
    uint64_t state;
    uint64_t left;
    const uint32_t *words;
} Rans;

/* Static tables by kind: number[k] of kind k's table, -1 for none. Table t has values[starts[t]..starts[t + 1] - 1],
and one prefix sum more, from sums[starts[t] + t] on. */
typedef struct {
    int64_t kinds;
    const int32_t *number;
    const int64_t *starts;
    const uint32_t *sums;
    const int32_t *values;
    uint8_t *used; /* per kind: set to 1 where a symbol was read */
} Tables;

#define ALL_READ (-1)
void scar_rans_uniform(Rans *rans, uint32_t size, int64_t n, int32_t *out);
int64_t scar_rans_grouped(Rans *rans, const Tables *tables, const uint16_t *kind, int64_t n, int64_t *counts,
                          int32_t *order, int32_t *out);

/* Sums over the anchors of each cell, at up to four depths, coarse first (SPEC 10.2). */
typedef struct {
    int64_t depths, columns;
    const int32_t *cell[4]; /* per anchor (n), its cell at each depth */
    double *sums[4];        /* (cells, columns + 1): sums, and in the last column the count */
} Cells;

/* Columns that a scene may average: 64 components of a channel, or those of all attributes and latents. */
#define MOST_CONTEXT_COLUMNS 512

INLINE double floor_of(double x) { return __builtin_floor(x); }

/* Means of one anchor's cells: mean[c * stride] of each column at `depth`; where a cell is empty, `before` is kept.
Returns the count. */
INLINE double cell_means(const Cells *cells, int64_t depth, int64_t anchor, double *restrict mean) {
    const double *restrict sums = cells->sums[depth] + cells->cell[depth][anchor] * (cells->columns + 1);
    const double count = sums[cells->columns];
    if (count > 0)
        for (int64_t c = 0; c < cells->columns; c++) mean[c] = floor_of((2 * sums[c] + count) / (2 * count));
    return count;
}

INLINE float count_feature(double count) {
    int digits = 0;
    for (double top = 1; digits < 8 && count >= top; top *= 2) digits++;
    return (float)(32 * digits);
}
