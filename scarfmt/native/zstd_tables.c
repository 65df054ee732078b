#include "zstd_tables.h"

#include <string.h>

#define BAD "bad-zstd"
#define WEIGHT_LOG 6
#define MOST_WEIGHTS 255
#define HUFFMAN_LOG 11
#define MOST_SYMBOLS 256

static int32_t digits(uint32_t x) { return x ? 32 - __builtin_clz(x) : 0; }

BackwardBits backward_bits(const uint8_t *bytes, int64_t length) {
    demand(length > 0 && bytes[length - 1], BAD);
    return (BackwardBits){bytes, length, 8 * length - 9 + digits(bytes[length - 1])};
}

/* Up to eight bytes from `byte` on, the first lowest. */
static uint64_t word_at(const uint8_t *bytes, int64_t length, int64_t byte) {
    uint64_t word = 0;
    if (length - byte >= 8) {
        memcpy(&word, bytes + byte, 8);
#if __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
        word = __builtin_bswap64(word);
#endif
    } else
        for (int64_t i = length; i-- > byte;) word = word << 8 | bytes[i];
    return word;
}

/* n <= 31 bits from bit `start` of the stream; those before its start are 0. */
static uint32_t bits_from(const BackwardBits *bits, int64_t start, int64_t n) {
    if (start < 0) return start + n <= 0 ? 0 : bits_from(bits, 0, start + n) << -start;
    return (uint32_t)(word_at(bits->bytes, bits->length, start >> 3) >> (start & 7)) & ((1u << n) - 1);
}

uint32_t backward_read(BackwardBits *bits, int64_t n) {
    bits->left -= n;
    return bits_from(bits, bits->left, n);
}

typedef struct {
    const uint8_t *bytes;
    int64_t length, at; /* at: in bits */
} ForwardBits;

/* n <= 16 bits, least significant first; those past the end are 0. */
static uint32_t forward_read(ForwardBits *bits, int64_t n) {
    const uint64_t word = word_at(bits->bytes, bits->length, bits->at >> 3);
    const uint32_t value = (uint32_t)(word >> (bits->at & 7)) & ((1u << n) - 1);
    bits->at += n;
    return value;
}

/* A count of at most `remaining`, or -1 for "less than one". */
static int32_t read_frequency(ForwardBits *bits, int32_t remaining) {
    const int32_t width = digits((uint32_t)remaining + 1), half = 1 << (width - 1);
    const int32_t spare = 2 * half - 1 - (remaining + 1), low = (int32_t)forward_read(bits, width - 1);
    if (low < spare) return low - 1;
    return (forward_read(bits, 1) ? low + half - spare : low) - 1;
}

int64_t read_fse(const uint8_t *bytes, int64_t length, int32_t most_log, int32_t most_symbol, FseTable *out) {
    int16_t counts[MOST_SYMBOLS + 4];
    ForwardBits bits = {bytes, length, 0};
    int32_t symbols = 0;
    const int32_t log = (int32_t)forward_read(&bits, 4) + 5;
    demand(log <= most_log, BAD);
    for (int32_t remaining = 1 << log; remaining > 0;) {
        demand(symbols <= most_symbol, BAD);
        const int32_t count = read_frequency(&bits, remaining);
        remaining -= count < 0 ? -count : count;
        counts[symbols++] = (int16_t)count;
        for (uint32_t more = count ? 0 : 3; more == 3;) {
            more = forward_read(&bits, 2);
            demand(symbols + (int32_t)more <= most_symbol + 1, BAD);
            for (uint32_t i = 0; i < more; i++) counts[symbols++] = 0;
        }
    }
    const int64_t end = (bits.at + 7) / 8;
    demand(end <= length, BAD);
    make_fse(counts, symbols, log, out);
    return end;
}

void make_fse(const int16_t *counts, int32_t symbols, int32_t log, FseTable *out) {
    const int32_t size = 1 << log, step = (size >> 1) + (size >> 3) + 3;
    uint16_t next[MOST_SYMBOLS + 4];
    int32_t high = size - 1;
    out->log = log;
    for (int32_t s = 0; s < symbols; s++) {
        next[s] = (uint16_t)(counts[s] < 0 ? 1 : counts[s]);
        if (counts[s] < 0) out->symbol[high--] = (uint8_t)s;
    }
    for (int32_t s = 0, at = 0; s < symbols; s++)
        for (int32_t i = 0; i < counts[s]; i++) {
            out->symbol[at] = (uint8_t)s;
            do at = (at + step) & (size - 1);
            while (at > high);
        }
    for (int32_t state = 0; state < size; state++) {
        const uint32_t number = next[out->symbol[state]]++;
        out->bits[state] = (uint8_t)(log + 1 - digits(number));
        out->base[state] = (uint16_t)((number << out->bits[state]) - (uint32_t)size);
    }
}

/* Weights coded by two FSE states in turns, until the bits are used up; returns how many. */
static int32_t compressed_weights(const uint8_t *bytes, int64_t length, uint8_t *weights) {
    FseTable table;
    const int64_t start = read_fse(bytes, length, WEIGHT_LOG, MOST_WEIGHTS, &table);
    BackwardBits bits = backward_bits(bytes + start, length - start);
    uint32_t states[2], turn = 0;
    for (int i = 0; i < 2; i++) states[i] = backward_read(&bits, table.log);
    demand(bits.left >= 0, BAD);
    for (int32_t n = 0;; turn ^= 1) {
        demand(n <= MOST_WEIGHTS - 2, BAD);
        const uint32_t state = states[turn];
        weights[n++] = table.symbol[state];
        states[turn] = table.base[state] + backward_read(&bits, table.bits[state]);
        if (bits.left >= 0) continue;
        weights[n++] = table.symbol[states[turn ^ 1]];
        return n;
    }
}

/* weights: of all symbols but the last, whose weight completes the tree; there is room for it. */
static void make_huffman(uint8_t *weights, int32_t n, HuffmanTable *out) {
    uint32_t sum = 0;
    for (int32_t s = 0; s < n; s++) {
        demand(weights[s] <= HUFFMAN_LOG, BAD);
        sum += weights[s] ? 1u << (weights[s] - 1) : 0;
    }
    demand(sum > 0, BAD);
    const int32_t log = digits(sum);
    const uint32_t rest = (1u << log) - sum;
    demand(log <= HUFFMAN_LOG && !(rest & (rest - 1)), BAD);
    weights[n++] = (uint8_t)digits(rest);
    out->log = log;
    for (int32_t weight = 1, at = 0; weight <= log; weight++)
        for (int32_t s = 0; s < n; s++) {
            const int32_t some = 1 << (weight - 1);
            if (weights[s] != weight) continue;
            memset(out->symbol + at, s, (size_t)some);
            memset(out->bits + at, log + 1 - weight, (size_t)some);
            at += some;
        }
}

int64_t read_huffman(const uint8_t *bytes, int64_t length, HuffmanTable *out) {
    uint8_t weights[MOST_SYMBOLS + 1];
    demand(length > 0, BAD);
    const int32_t head = bytes[0];
    const int64_t size = head < 128 ? head : (head - 126) >> 1;
    int32_t n = head - 127;
    demand(1 + size <= length, BAD);
    if (head < 128)
        n = compressed_weights(bytes + 1, size, weights);
    else
        for (int32_t i = 0; i < n; i++) weights[i] = i % 2 ? bytes[1 + i / 2] & 15 : bytes[1 + i / 2] >> 4;
    make_huffman(weights, n, out);
    return 1 + size;
}

void huffman_stream(const HuffmanTable *table, const uint8_t *bytes, int64_t length, uint8_t *out, int64_t n) {
    BackwardBits bits = backward_bits(bytes, length);
    for (int64_t i = 0; i < n; i++) {
        const uint32_t index = bits_from(&bits, bits.left - table->log, table->log);
        out[i] = table->symbol[index];
        bits.left -= table->bits[index];
        demand(bits.left >= 0, BAD);
    }
    demand(!bits.left, BAD);
}
