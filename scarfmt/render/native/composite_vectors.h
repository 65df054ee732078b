/* Vectors of the pixels of a row, for composite_tiles.h. */

#include <stdint.h>

#define PART static inline __attribute__((always_inline, TARGET))

/* Columns worked on together. */
#define SPAN 8
typedef float V __attribute__((vector_size(4 * SPAN)));
typedef int32_t M __attribute__((vector_size(4 * SPAN)));
typedef float Half __attribute__((vector_size(2 * SPAN)));
