#include "zstd.h"

#include <string.h>

#include "crc32.h"
#include "zstd_tables.h"

#define BAD "bad-zstd"
#define MAGIC 0xFD2FB528u
#define MOST_WINDOW 8388608
#define MOST_BLOCK 131072
#define LITERAL_LENGTHS 36
#define MATCH_LENGTHS 53
#define KINDS 3 /* of sequence codes: literal lengths, offsets, match lengths */

typedef struct {
    const uint8_t *in;
    int64_t length, at;
    uint8_t *out;
    int64_t size, filled, block; /* block: most bytes of one */
    HuffmanTable huffman;
    FseTable tables[KINDS];
    int64_t recent[3];
    uint8_t literals[MOST_BLOCK];
} ZstdFrame;

/* The literals of a block. */
typedef struct {
    const uint8_t *bytes;
    int64_t length, used;
} Literals;

static const uint8_t LITERAL_BITS[LITERAL_LENGTHS] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,  1,  1,
                                                      1, 1, 2, 2, 3, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
static const uint8_t MATCH_BITS[MATCH_LENGTHS] = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                                                  0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1,
                                                  2, 2, 3, 3, 4, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
static const int16_t DEFAULT_LITERALS[36] = {4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2,
                                             2, 2, 2, 2, 2, 2, 2, 3, 2, 1, 1, 1, 1, 1, -1, -1, -1, -1};
static const int16_t DEFAULT_OFFSETS[29] = {1, 1, 1, 1, 1, 1, 2, 2, 2, 1, 1, 1, 1, 1, 1,
                                            1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1};
static const int16_t DEFAULT_MATCHES[53] = {1, 4, 3, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1,
                                            1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
                                            1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1, -1, -1};
static const struct {
    const int16_t *counts;
    int32_t symbols, log, most_log, most_symbol;
} KIND[KINDS] = {{DEFAULT_LITERALS, 36, 6, 9, 35}, {DEFAULT_OFFSETS, 29, 5, 8, 31}, {DEFAULT_MATCHES, 53, 6, 9, 52}};

/* The least value of a code: values follow one another without a gap. */
static int64_t base_of(const uint8_t *bits, int64_t code, int64_t first) {
    int64_t base = first;
    for (int64_t i = 0; i < code; i++) base += (int64_t)1 << bits[i];
    return base;
}

static uint64_t little(const uint8_t *bytes, int64_t length, int64_t at, int64_t n) {
    uint64_t value = 0;
    demand(at + n <= length, BAD);
    while (n--) value = value << 8 | bytes[at + n];
    return value;
}

FrameHeader zstd_header(const uint8_t *bytes, int64_t length, int64_t most) {
    static const int64_t dictionary[4] = {0, 1, 2, 4}, sizes[4] = {0, 2, 4, 8};
    demand(length >= 5 && little32(bytes) == MAGIC, BAD);
    const int64_t descriptor = bytes[4], single = descriptor >> 5 & 1;
    demand(!(descriptor & 12), BAD);
    int64_t at = 5;
    const uint64_t window = single ? 0 : little(bytes, length, at, 1), base = 1ull << (10 + (window >> 3));
    at += !single;
    demand(!little(bytes, length, at, dictionary[descriptor & 3]), BAD);
    at += dictionary[descriptor & 3];
    const int64_t size = descriptor >> 6 ? sizes[descriptor >> 6] : single;
    demand(size > 0, BAD);
    const uint64_t content = little(bytes, length, at, size) + (size == 2 ? 256 : 0);
    demand(content > 0, BAD);
    demand(content <= (uint64_t)most, "content-limit");
    const uint64_t reach = single ? content : base + base / 8 * (window & 7);
    demand(reach <= MOST_WINDOW, BAD);
    return (FrameHeader){(int64_t)content, (int64_t)reach, at + size};
}

static void append(ZstdFrame *f, const uint8_t *bytes, int64_t n) {
    demand(n <= f->size - f->filled, BAD);
    memcpy(f->out + f->filled, bytes, (size_t)n);
    f->filled += n;
}

static void copy_match(ZstdFrame *f, int64_t offset, int64_t n) {
    demand(offset >= 1 && offset <= f->filled && n <= f->size - f->filled, BAD);
    uint8_t *to = f->out + f->filled;
    if (offset >= n)
        memcpy(to, to - offset, (size_t)n);
    else
        for (int64_t i = 0; i < n; i++) to[i] = to[i - offset];
    f->filled += n;
}

/* Offset values 1 to 3 name recent offsets (RFC 8878, 3.1.1.5). */
static int64_t next_offset(int64_t recent[3], int64_t value, int64_t literals) {
    const int64_t which = value > 3 ? 3 : value - 1 + !literals;
    const int64_t offset = value > 3 ? value - 3 : which == 3 ? recent[0] - 1 : recent[which];
    if (which > 1) recent[2] = recent[1];
    if (which > 0) recent[1] = recent[0];
    return recent[0] = offset;
}

/* Where the description of the table of a kind of codes ends. */
static int64_t sequence_table(ZstdFrame *f, int kind, int mode, const uint8_t *bytes, int64_t length, int64_t at) {
    FseTable *table = f->tables + kind;
    if (mode == 0) {
        make_fse(KIND[kind].counts, KIND[kind].symbols, KIND[kind].log, table);
    } else if (mode == 1) {
        demand(at < length && bytes[at] <= KIND[kind].most_symbol, BAD);
        table->log = 0, table->symbol[0] = bytes[at++], table->bits[0] = 0, table->base[0] = 0;
    } else if (mode == 2) {
        at += read_fse(bytes + at, length - at, KIND[kind].most_log, KIND[kind].most_symbol, table);
    } else {
        demand(table->log >= 0, BAD);
    }
    return at;
}

static uint32_t moved(BackwardBits *bits, const FseTable *table, uint32_t state) {
    return table->base[state] + backward_read(bits, table->bits[state]);
}

static void run_sequences(ZstdFrame *f, int64_t count, BackwardBits bits, Literals *literals) {
    const FseTable *lengths = f->tables, *offsets = f->tables + 1, *matches = f->tables + 2;
    uint32_t length_state = backward_read(&bits, lengths->log), offset_state = backward_read(&bits, offsets->log);
    uint32_t match_state = backward_read(&bits, matches->log);
    for (int64_t i = 0; i < count; i++) {
        const int64_t offset_code = offsets->symbol[offset_state], match_code = matches->symbol[match_state];
        const int64_t length_code = lengths->symbol[length_state];
        const int64_t value = ((int64_t)1 << offset_code) + backward_read(&bits, offset_code);
        const int64_t match = base_of(MATCH_BITS, match_code, 3) + backward_read(&bits, MATCH_BITS[match_code]);
        const int64_t some = base_of(LITERAL_BITS, length_code, 0) + backward_read(&bits, LITERAL_BITS[length_code]);
        if (i + 1 < count) {
            length_state = moved(&bits, lengths, length_state);
            match_state = moved(&bits, matches, match_state);
            offset_state = moved(&bits, offsets, offset_state);
        }
        demand(bits.left >= 0 && some <= literals->length - literals->used, BAD);
        append(f, literals->bytes + literals->used, some);
        literals->used += some;
        copy_match(f, next_offset(f->recent, value, some), match);
    }
    demand(!bits.left, BAD);
}

/* The sequences of a block, which end with it (RFC 8878, 3.1.1.3.2). */
static void read_sequences(ZstdFrame *f, const uint8_t *bytes, int64_t length, int64_t at, Literals *literals) {
    demand(at < length, BAD);
    int64_t count = bytes[at++];
    if (count >= 128) {
        const int64_t more = count == 255 ? 2 : 1;
        const int64_t rest = (int64_t)little(bytes, length, at, more);
        count = more == 2 ? rest + 0x7f00 : (count - 128) * 256 + rest;
        at += more;
    }
    if (!count) {
        demand(at == length, BAD);
        return;
    }
    demand(at < length && !(bytes[at] & 3), BAD);
    const int modes = bytes[at++];
    for (int kind = 0; kind < KINDS; kind++)
        at = sequence_table(f, kind, modes >> (6 - 2 * kind) & 3, bytes, length, at);
    run_sequences(f, count, backward_bits(bytes + at, length - at), literals);
}

static void four_streams(const HuffmanTable *table, const uint8_t *bytes, int64_t length, uint8_t *out, int64_t n) {
    const int64_t each = (n + 3) >> 2;
    demand(length >= 6 && 3 * each <= n, BAD);
    int64_t at = 6;
    for (int i = 0; i < 4; i++) {
        const int64_t past = i < 3 ? at + (int64_t)little(bytes, length, 2 * i, 2) : length;
        demand(past <= length, BAD);
        huffman_stream(table, bytes + at, past - at, out + i * each, i < 3 ? each : n - 3 * each);
        at = past;
    }
}

/* The literals at the start of a block; returns where they end (RFC 8878, 3.1.1.3.1). */
static int64_t read_literals(ZstdFrame *f, const uint8_t *bytes, int64_t length, Literals *out) {
    static const int64_t plain[4] = {1, 2, 1, 3}, coded[4] = {3, 3, 4, 5}, widths[4] = {10, 10, 14, 18};
    demand(length > 0, BAD);
    const int type = bytes[0] & 3, format = bytes[0] >> 2 & 3;
    int64_t at = type < 2 ? plain[format] : coded[format];
    const uint64_t header = little(bytes, length, 0, at);
    if (type < 2) {
        const int64_t size = (int64_t)(header >> (at == 1 ? 3 : 4)), end = at + (type ? 1 : size);
        demand(end <= length && size <= f->block, BAD);
        if (type) memset(f->literals, bytes[at], (size_t)size);
        *out = (Literals){type ? f->literals : bytes + at, size, 0};
        return end;
    }
    const int64_t size = (int64_t)(header >> 4 & ((1ull << widths[format]) - 1));
    const int64_t end = at + (int64_t)(header >> (4 + widths[format]));
    demand(end <= length && size <= f->block, BAD);
    if (type == 2) at += read_huffman(bytes + at, end - at, &f->huffman);
    demand(f->huffman.log > 0, BAD);
    if (format == 0)
        huffman_stream(&f->huffman, bytes + at, end - at, f->literals, size);
    else
        four_streams(&f->huffman, bytes + at, end - at, f->literals, size);
    *out = (Literals){f->literals, size, 0};
    return end;
}

/* Whether the block was the last. */
static int read_block(ZstdFrame *f) {
    const int64_t header = (int64_t)little(f->in, f->length, f->at, 3), size = header >> 3, type = header >> 1 & 3;
    const uint8_t *bytes = f->in + f->at + 3;
    demand(type < 3, BAD);
    f->at += 3 + (type == 1 ? 1 : size);
    demand(f->at <= f->length && size <= f->block, BAD);
    if (type == 0) {
        append(f, bytes, size);
    } else if (type == 1) {
        demand(size <= f->size - f->filled, BAD);
        memset(f->out + f->filled, *bytes, (size_t)size);
        f->filled += size;
    } else {
        const int64_t start = f->filled;
        Literals literals;
        const int64_t at = read_literals(f, bytes, size, &literals);
        read_sequences(f, bytes, size, at, &literals);
        append(f, literals.bytes + literals.used, literals.length - literals.used);
        demand(f->filled - start <= f->block, BAD);
    }
    return header & 1;
}

Content zstd_content(const uint8_t *bytes, int64_t length, FrameHeader header, Pool *pool) {
    ZstdFrame *f = pool_take(pool, sizeof *f);
    f->in = bytes, f->length = length, f->at = header.at;
    f->out = pool_take(pool, header.content), f->size = header.content, f->filled = 0;
    f->block = header.window < MOST_BLOCK ? header.window : MOST_BLOCK;
    f->huffman.log = 0;
    for (int kind = 0; kind < KINDS; kind++) f->tables[kind].log = -1;
    f->recent[0] = 1, f->recent[1] = 4, f->recent[2] = 8;
    while (!read_block(f)) continue;
    demand(f->filled == f->size && f->at == f->length, BAD);
    return (Content){f->out, f->size};
}
