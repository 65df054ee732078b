/* Blocks side by side from the end of the module's data on, each with a header; free neighbours are joined. What is
wanted goes to the first block that fits. */

#include "memory.h"

#include "fault.h"
#include "kernel.h"

#define ALIGNED 64
#define PAGE 65536

typedef struct Block {
    struct Block *before, *after; /* in memory, NULL at the ends */
    int64_t size;                 /* bytes after the header */
    int64_t free;
    uint8_t unused[ALIGNED - 16 - 2 * sizeof(void *)];
} Block;

_Static_assert(sizeof(Block) == ALIGNED, "a header is as long as blocks are aligned");

extern uint8_t __heap_base;

static Block *last;
static Block *lowest; /* no block before it is free; NULL: none is */
static int64_t held;

static int64_t rounded(int64_t bytes) { return (bytes + ALIGNED - 1) / ALIGNED * ALIGNED; }

static uint8_t *body(Block *block) { return (uint8_t *)block + ALIGNED; }

static int64_t end_of(Block *block) { return (int64_t)(uintptr_t)body(block) + block->size; }

/* Grows the module's memory to reach `end`. */
static void reach(int64_t end) {
    const int64_t pages = (end + PAGE - 1) / PAGE - (int64_t)__builtin_wasm_memory_size(0);
    demand(end <= MOST_BYTES, "limit-memory");
    if (pages > 0 && __builtin_wasm_memory_grow(0, (size_t)pages) == SIZE_MAX) refuse("limit-memory");
}

/* Splits what a block has beyond `size` off. */
static void split(Block *block, int64_t size) {
    if (block->size < size + 2 * ALIGNED) return;
    Block *rest = (Block *)(body(block) + size);
    *rest = (Block){.before = block, .after = block->after, .size = block->size - size - ALIGNED, .free = 1};
    if (rest->after) rest->after->before = rest; else last = rest;
    block->after = rest, block->size = size;
}

/* A block at the end, or the last one made longer if it is free. */
static Block *added(int64_t size) {
    if (last && last->free) {
        reach((int64_t)(uintptr_t)body(last) + size);
        last->size = size;
        return last;
    }
    const int64_t start = last ? end_of(last) : rounded((int64_t)(uintptr_t)&__heap_base);
    reach(start + ALIGNED + size);
    Block *block = (Block *)(uintptr_t)start;
    *block = (Block){.before = last, .size = size};
    if (last) last->after = block;
    return last = block;
}

void *memory_take(int64_t bytes) {
    demand(bytes >= 0 && bytes <= MOST_BYTES, "limit-memory");
    const int64_t size = rounded(bytes + !bytes);
    Block *block = lowest;
    while (block && !(block->free && block->size >= size)) block = block->after;
    if (!block) block = added(size);
    split(block, size);
    block->free = 0, held += block->size;
    while (lowest && !lowest->free) lowest = lowest->after;
    return body(block);
}

/* Joins a free block and the free one after it. */
static void join(Block *block) {
    Block *other = block->after;
    block->size += ALIGNED + other->size, block->after = other->after;
    if (other->after) other->after->before = block; else last = block;
}

void memory_give(void *memory) {
    if (!memory) return;
    Block *block = (Block *)((uint8_t *)memory - ALIGNED);
    block->free = 1, held -= block->size;
    if (block->after && block->after->free) join(block);
    if (block->before && block->before->free) block = block->before, join(block);
    if (!lowest || block < lowest) lowest = block;
}

/* Memory that whoever calls fills in, and gives back by scar_give. */
EXPORT void *scar_take(int32_t bytes) { return memory_take((uint32_t)bytes); }
EXPORT void scar_give(void *memory) { memory_give(memory); }

/* Bytes in use. */
EXPORT double scar_memory(void) { return (double)held; }
