/* What the kernel's files share. Compiled by GCC or Clang as a plain library: no Python header is needed, ctypes
calls it.

Exact arithmetic throughout: the same numbers come from Python where this was not compiled, and tests compare them. No
function allocates. What indexes an array comes from other arrays that the caller made, never unchecked from a file. */

#ifndef SCAR_KERNEL_H
#define SCAR_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "compiler.h"
#include "structs.h"

/* Rows of words are filled up to be read by four. */
INLINE int64_t fours(int64_t words) { return (words + 3) & ~(int64_t)3; }

#define ALL_READ (-1)
void scar_rans_open(Rans *rans);
void scar_rans_uniform(Rans *rans, uint32_t size, int64_t n, int32_t *out);
int64_t scar_rans_grouped(Rans *rans, const Tables *tables, const uint16_t *kind, int64_t n, int64_t *counts,
                          int32_t *order, int32_t *out);

#endif
