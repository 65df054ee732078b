/* The module's own memory: what is taken lies in it until it is given back; without room the call is refused. */

#ifndef SCAR_MEMORY_H
#define SCAR_MEMORY_H

#include <stddef.h>
#include <stdint.h>

#if defined(__wasm__)
#define THREAD
#else
#define THREAD _Thread_local
#endif

#define MOST_BYTES 0xffff0000ll /* at once */

/* `bytes` bytes with anything in them, aligned to 64; refuses limit-memory. */
void *memory_take(int64_t bytes);

/* Gives back what memory_take gave; NULL is allowed. */
void memory_give(void *memory);

/* Memory that is given back as a whole. All zeros: an empty one. */
typedef struct {
    struct Chunk *chunks;
    int64_t used; /* of the first chunk */
} Pool;

void *pool_take(Pool *pool, int64_t bytes);
void *pool_zeros(Pool *pool, int64_t bytes);

/* Gives back all of it, but keeps one chunk as large as what was taken if `keep`. */
void pool_empty(Pool *pool, int keep);

#endif
