/* The sub-streams of a TILE block (SPEC 7.1). */

#include <string.h>

#include "crc32.h"
#include "tile.h"

#define MOST_RECORDS 11
#define RECORD_BYTES 9
#define BAD "bad-substream-table"

static CrcTable crc;

static uint32_t crc_of(const uint8_t *bytes, int64_t length) {
    if (!crc[0][1]) crc32_table(crc);
    return crc32_of(crc, bytes, length);
}

/* R-7.1-4. */
static int may_have(const Work *w, int64_t stream) {
    if (stream == POSITIONS || stream == CLASSES) return w->new > 0;
    if (stream == MASKS) return w->m->profile == ANCHOR;
    return stream == INDICES || channel_of(w->m, stream) >= 0;
}

/* R-7.1-1 to R-7.1-5. */
void find_parts(Work *w, Body block) {
    memset(w->parts, 0, sizeof w->parts);
    if (!block.length) return;
    const int64_t records = block.bytes[0], table = 1 + RECORD_BYTES * records;
    demand(records <= MOST_RECORDS && table + 4 <= block.length, BAD);
    demand(crc_of(block.bytes, table) == little32(block.bytes + table), "crc-mismatch");
    int64_t before = 0, end = table + 4;
    for (const uint8_t *record = block.bytes + 1; record < block.bytes + table; record += RECORD_BYTES) {
        const int64_t stream = record[0], length = little32(record + 1);
        demand(stream > before && stream < STREAM_KINDS && length && length % 4 == 0, BAD);
        before = stream, end += length;
    }
    demand(end == block.length, BAD);
    for (int64_t i = 0; i < records; i++) demand(may_have(w, block.bytes[1 + RECORD_BYTES * i]), BAD);
    const uint8_t *at = block.bytes + table + 4;
    for (const uint8_t *record = block.bytes + 1; record < block.bytes + table; record += RECORD_BYTES) {
        const int64_t length = little32(record + 1);
        demand(crc_of(at, length) == little32(record + 5), "crc-mismatch");
        w->parts[record[0]] = (Body){at, length};
        at += length;
    }
}

Rans open_stream(const Work *w, int64_t stream) {
    const Body part = w->parts[stream];
    const int64_t count = part.length / 4;
    uint32_t *words = pool_take(&layer_scratch, part.length);
    if (count) memcpy(words, part.bytes, (size_t)part.length);
    demand(!count || words[count - 1], "rans-last-word");
    Rans rans = {0, (uint64_t)count, words};
    scar_rans_open(&rans);
    return rans;
}

void seal_stream(const Rans *rans) { demand(!rans->state && !rans->left, "rans-seal"); }

void read_kinds(Work *w, Rans *rans, const Tables *tables, const uint16_t *kinds, int64_t n) {
    const int64_t read = scar_rans_grouped(rans, tables, kinds, n, w->counts, w->statics.order, w->symbols);
    demand(read == ALL_READ, "missing-table");
}
