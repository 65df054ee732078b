/* The sub-streams of a TILE block (SPEC 7.1), and streams of any block opened and sealed (SPEC 8.2). */

#include <string.h>

#include "crc32.h"
#include "tile.h"

#define MOST_RECORDS 11
#define RECORD_BYTES 9
#define BAD "bad-substream-table"

/* Filled before anything is read, with the same numbers by every thread. */
static CrcTable crc;

void fill_crc_table(void) {
    if (!crc[CRC_SLICES - 1][255]) crc32_table(crc);
}

/* R-7.1-4. */
static int may_have(const Work *w, int64_t stream) {
    if (stream == POSITIONS || stream == CLASSES) return w->new > 0;
    if (stream == MASKS) return w->m->profile == ANCHOR;
    return stream == INDICES || channel_of(w->m, stream) >= 0;
}

static int is_read(const Work *w, int64_t stream) { return stream <= MASKS || w->streams >> stream & 1; }

/* R-7.1-1 to R-7.1-5. */
void find_parts(Work *w, Body block) {
    memset(w->parts, 0, sizeof w->parts);
    if (!block.length) return;
    const int64_t records = block.bytes[0], table = 1 + RECORD_BYTES * records;
    demand(records <= MOST_RECORDS && table + 4 <= block.length, BAD);
    demand(crc32_of(crc, block.bytes, table) == little32(block.bytes + table), "crc-mismatch");
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
        if (is_read(w, record[0])) demand(crc32_of(crc, at, length) == little32(record + 5), "crc-mismatch");
        w->parts[record[0]] = (Body){at, length};
        at += length;
    }
}

const char *open_words(Body bytes, Rans *out) {
    const int64_t count = bytes.length / 4;
    if (bytes.length % 4) return "rans-length";
    uint32_t *words = pool_take(&layer_scratch, bytes.length);
    for (int64_t i = 0; i < count; i++) words[i] = little32(bytes.bytes + 4 * i);
    *out = (Rans){0, (uint64_t)count, words};
    scar_rans_open(out);
    return !count || words[count - 1] ? NULL : "rans-last-word";
}

Rans open_stream(Body bytes) {
    Rans rans;
    const char *fault = open_words(bytes, &rans);
    demand(!fault, fault);
    return rans;
}

void seal_stream(const Rans *rans) { demand(!rans->state && !rans->left, "rans-seal"); }

void read_kinds(Work *w, Rans *rans, const Tables *tables, const uint16_t *kinds, int64_t n) {
    const int64_t read = scar_rans_grouped(rans, tables, kinds, n, w->counts, w->order, w->symbols);
    demand(read == ALL_READ, "missing-table");
}
