/* HASH_GRID blocks (SPEC 10.6). */

#include "tile.h"
#include "rans.h"

#define MOST_LEVELS 16
#define MOST_BITS (1 << 24)
#define MOST_RESOLUTION 65535
#define MOST_TABLE_LOG2 19
#define MOST_FEATURES 8
#define PLANES 7
#define BAD "bad-grid"

static const struct {
    int64_t dims, axes[3];
} PLANE[PLANES] = {{3, {0, 1, 2}}, {2, {0, 1}}, {2, {0, 2}}, {2, {1, 2}}, {1, {0}}, {1, {1}}, {1, {2}}};

/* The head of a level, not yet checked, but that its plane is one. */
typedef struct {
    int64_t plane, resolution, table_log2, features;
} LevelHead;

static void check_head(const LevelHead *head) {
    demand(head->plane < PLANES && head->resolution >= 1 && head->resolution <= MOST_RESOLUTION, BAD);
    demand(head->table_log2 >= 1 && head->table_log2 <= MOST_TABLE_LOG2, BAD);
    demand(head->features >= 1 && head->features <= MOST_FEATURES, BAD);
}

static int64_t vertices_of(const GridLevel *level) {
    int64_t vertices = 1;
    for (int64_t d = 0; d < level->dims; d++) vertices *= level->resolution + 1;
    return vertices;
}

int64_t grid_bits(const GridLevel *level) {
    return (level->dense ? vertices_of(level) : (int64_t)1 << level->table_log2) * level->features;
}

/* The stream of a level. */
static const uint8_t *read_bits(Reader *reader, Pool *pool, int64_t n) {
    const uint32_t ones = read_u8(reader);
    demand(ones, BAD);
    const int64_t length = read_u32(reader);
    Rans rans = open_stream((Body){read_bytes(reader, length), length});
    /* Of weights 256 - ones and ones (SPEC 8.1). */
    const uint32_t second = (uint32_t)((uint64_t)(256 - ones) * (TOTAL - 2) / 256 + 1);
    uint8_t *bits = pool_take(pool, n);
    for (int64_t i = 0; i < n; i++) {
        const uint32_t slot = (uint32_t)rans.state & SLOT_MASK;
        bits[i] = slot >= second;
        advance(&rans, slot, bits[i] ? second : 0, bits[i] ? TOTAL : second);
    }
    seal_stream(&rans);
    return bits;
}

void read_grid(Model *m, Body block) {
    Reader reader = {block.bytes, block.length, 0};
    LevelHead heads[UINT8_MAX];
    Grid *grid = &m->grid;
    int64_t total = 0;
    for (int d = 0; d < 3; d++) grid->origin[d] = read_u32(&reader);
    grid->extent_bits = read_u8(&reader);
    const int64_t count = read_u8(&reader);
    for (int64_t l = 0; l < count; l++) {
        heads[l].plane = read_u8(&reader), heads[l].resolution = read_u32(&reader);
        heads[l].table_log2 = read_u8(&reader), heads[l].features = read_u8(&reader);
    }
    demand(grid->extent_bits <= 32 && count >= 1 && count <= MOST_LEVELS, BAD);
    for (int64_t l = 0; l < count; l++) check_head(heads + l);
    GridLevel *levels = pool_zeros(&m->pool, (int64_t)sizeof *levels * count);
    grid->width = 0;
    for (int64_t l = 0; l < count; l++) {
        GridLevel *level = levels + l;
        level->dims = PLANE[heads[l].plane].dims;
        for (int d = 0; d < 3; d++) level->axes[d] = PLANE[heads[l].plane].axes[d];
        level->resolution = heads[l].resolution, level->table_log2 = heads[l].table_log2;
        level->features = heads[l].features;
        level->dense = vertices_of(level) <= (int64_t)1 << level->table_log2;
        total += grid_bits(level);
        grid->width += level->features;
    }
    demand(total <= MOST_BITS, BAD);
    for (int64_t l = 0; l < count; l++) levels[l].bits = read_bits(&reader, &m->pool, grid_bits(levels + l));
    read_end(&reader);
    grid->levels = count, grid->level = levels;
}
