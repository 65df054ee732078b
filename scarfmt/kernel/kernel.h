/* What the kernel's files share. Compiled by GCC or Clang as a plain library: no Python header is needed, ctypes
calls it.

Exact arithmetic throughout: the same numbers come from Python where this was not compiled, and tests compare them. No
function allocates. What indexes an array comes from other arrays that the caller made, never unchecked from a file. */

#ifndef SCAR_KERNEL_H
#define SCAR_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))

/* Grows with every change of a function's arguments or of a struct: interface.py loads no other. */
#define INTERFACE 2

/* Wider vectors where the machine has them, chosen when the library is loaded: glibc can, musl cannot. */
#if defined(__x86_64__) && defined(__GLIBC__) && __GNUC__ >= 12 && !defined(__clang__)
#define WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define WIDE
#endif

/* Compiled anew in each caller, for the vectors that it uses. */
#define INLINE static inline __attribute__((always_inline))

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

#endif
