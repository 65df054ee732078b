/* Splats sorted by depth and listed by tiles. Serial: each is a pass through memory. */

#include <string.h>

#include "raster.h"

#define DIGIT_BITS 11
#define DIGITS (1 << DIGIT_BITS)

uint64_t *sort_entries(uint64_t *entries, uint64_t *spare, int64_t count) {
    for (int shift = 32; shift < 64; shift += DIGIT_BITS) {
        int64_t starts[DIGITS + 1] = {0};
        for (int64_t i = 0; i < count; i++) starts[(entries[i] >> shift) % DIGITS + 1]++;
        for (int i = 0; i < DIGITS; i++) starts[i + 1] += starts[i];
        for (int64_t i = 0; i < count; i++) spare[starts[(entries[i] >> shift) % DIGITS]++] = entries[i];
        uint64_t *sorted = spare;
        spare = entries, entries = sorted;
    }
    return entries;
}

static int32_t between(float value, int32_t most) { return value < 0 ? 0 : value > (float)most ? most : (int32_t)value; }

/* Fills the (seen, 4) `spans`, first and last column and row of tiles with pixel centres in the bounds of a splat; the
(seen + 1,) `starts`, numbers of intersections; and the (tiles + 1,) `offsets`, where the lists of tiles start. */
EXPORT void scar_count_tiles(const Splat *splats, int64_t seen, int64_t width, int64_t height, int32_t *spans,
                             int64_t *starts, int64_t *offsets) {
    int64_t columns = (width + TILE - 1) / TILE, tiles = columns * ((height + TILE - 1) / TILE);
    memset(offsets, 0, sizeof(int64_t) * (tiles + 1));
    starts[0] = 0;
    for (int64_t i = 0; i < seen; i++) {
        const Splat *s = splats + i;
        float half_x = s->ellipse.half_x, half_y = s->ellipse.half_y;
        int32_t *span = spans + 4 * i;
        /* Whole numbers up from 0: to add one and cut off rounds up, or names the next where it was whole. */
        span[0] = between(s->mean_x - half_x + 0.499f, (int32_t)width - 1) / TILE;
        span[1] = between(s->mean_x + half_x - 0.5f, (int32_t)width - 1) / TILE;
        span[2] = between(s->mean_y - half_y + 0.499f, (int32_t)height - 1) / TILE;
        span[3] = between(s->mean_y + half_y - 0.5f, (int32_t)height - 1) / TILE;
        for (int32_t row = span[2]; row <= span[3]; row++)
            for (int32_t column = span[0]; column <= span[1]; column++) offsets[row * columns + column + 1]++;
        starts[i + 1] = starts[i] + (int64_t)(span[1] - span[0] + 1) * (span[3] - span[2] + 1);
    }
    for (int64_t tile = 0; tile < tiles; tile++) offsets[tile + 1] += offsets[tile];
}

/* Fills `listed`, unless it is null, and `owners` of a Job; `fill` is a copy of the offsets, and is used up. */
EXPORT void scar_list_tiles(const int32_t *spans, int64_t seen, int64_t columns, int64_t *fill, int32_t *listed,
                            int32_t *owners) {
    int32_t number = 0;
    for (int64_t i = 0; i < seen; i++) {
        const int32_t *span = spans + 4 * i;
        for (int32_t row = span[2]; row <= span[3]; row++)
            for (int32_t column = span[0]; column <= span[1]; column++, number++) {
                int64_t place = fill[row * columns + column]++;
                if (listed) listed[place] = number;
                owners[place] = (int32_t)i;
            }
    }
}
