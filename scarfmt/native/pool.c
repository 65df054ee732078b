/* Pools: chunks of memory one after the other, of which the last is cut into what is asked for. */

#include <string.h>

#include "fault.h"
#include "memory.h"

#define HEADER 64
#define ALIGNED 16
#define LEAST_CHUNK (1 << 18)

struct Chunk {
    struct Chunk *next;
    int64_t size; /* bytes after the header */
};

void *pool_take(Pool *pool, int64_t bytes) {
    if (bytes < 0 || bytes > MOST_BYTES) refuse("limit-memory");
    const int64_t size = (bytes + ALIGNED - 1) / ALIGNED * ALIGNED;
    struct Chunk *chunk = pool->chunks;
    if (!chunk || pool->used + size > chunk->size) {
        const int64_t room = size > LEAST_CHUNK ? size : LEAST_CHUNK;
        chunk = memory_take(HEADER + room);
        chunk->next = pool->chunks, chunk->size = room;
        pool->chunks = chunk, pool->used = 0;
    }
    void *at = (uint8_t *)chunk + HEADER + pool->used;
    pool->used += size;
    return at;
}

void *pool_zeros(Pool *pool, int64_t bytes) {
    void *at = pool_take(pool, bytes);
    memset(at, 0, (size_t)bytes);
    return at;
}

void pool_empty(Pool *pool, int keep) {
    int64_t size = 0, chunks = 0;
    for (struct Chunk *chunk = pool->chunks; chunk; chunk = chunk->next) size += chunk->size, chunks++;
    pool->used = 0;
    if (keep && chunks <= 1) return;
    for (struct Chunk *chunk = pool->chunks, *next; chunk; chunk = next) next = chunk->next, memory_give(chunk);
    pool->chunks = NULL;
    if (!keep) return;
    struct Chunk *chunk = memory_take(HEADER + size);
    chunk->next = NULL, chunk->size = size, pool->chunks = chunk;
}
