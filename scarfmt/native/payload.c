#include "payload.h"

#include <string.h>

#include "crc32.h"

#define MOST_SHIFT 31
#define MOST_QUOTIENT 255
#define QUOTIENT_BYTES 32 /* that n quotients of up to 255 fit in, for each */

const uint8_t *read_bytes(Reader *reader, int64_t n) {
    const int64_t at = reader->at;
    demand(n <= reader->length - at, "payload-short");
    reader->at += n;
    return reader->bytes + at;
}

uint8_t read_u8(Reader *reader) { return *read_bytes(reader, 1); }

uint32_t read_u32(Reader *reader) { return little32(read_bytes(reader, 4)); }

double read_f64(Reader *reader) {
    const uint64_t low = read_u32(reader), bits = (uint64_t)read_u32(reader) << 32 | low;
    double out;
    memcpy(&out, &bits, 8);
    return out;
}

uint64_t read_varint(Reader *reader, int64_t bits) {
    uint64_t value = 0;
    for (int64_t shift = 0;; shift += 7) {
        const uint64_t byte = read_u8(reader);
        demand(shift < 63, "bad-varint"); /* a tenth byte has nothing that fits */
        value |= (byte & 127) << shift;
        if (byte < 128) {
            demand(value >> bits == 0 && (byte || !shift), "bad-varint");
            return value;
        }
        demand(shift + 7 <= bits, "bad-varint");
    }
}

int64_t read_count(Reader *reader, int64_t most) {
    const uint64_t value = read_varint(reader, 63);
    demand(value <= (uint64_t)most, "count-limit");
    return (int64_t)value;
}

/* The run of bits 1 before each of the next n bits 0, and the fill bits (R-5.9-3). */
static void read_quotients(Reader *reader, int64_t n, int32_t *out) {
    const int64_t left = reader->length - reader->at;
    const int64_t length = left < QUOTIENT_BYTES * n ? left : QUOTIENT_BYTES * n;
    const uint8_t *bytes = reader->bytes + reader->at;
    int64_t found = 0, at = 0;
    int32_t run = 0, most = 0;
    int bit = 0;
    for (; found < n && at < length; at++)
        for (bit = 7; bit >= 0; bit--) {
            if (bytes[at] >> bit & 1) {
                run++;
                continue;
            }
            most = run > most ? run : most;
            out[found++] = run, run = 0;
            if (found == n) break;
        }
    demand(found == n || length == QUOTIENT_BYTES * n, "payload-short");
    demand(found == n && most <= MOST_QUOTIENT, "bad-rice");
    demand(!(bytes[at - 1] & ((1 << bit) - 1)), "bad-rice");
    reader->at += at;
}

/* `width` bits from the bit-th on, most significant first. */
static uint64_t bits_at(const uint8_t *bytes, int64_t bit, int64_t width) {
    uint64_t value = 0;
    for (int64_t left = width; left > 0;) {
        const int64_t inside = 8 - (bit & 7), some = inside < left ? inside : left;
        value = value << some | (bytes[bit >> 3] >> (inside - some) & ((1 << some) - 1));
        bit += some, left -= some;
    }
    return value;
}

void read_rice(Reader *reader, int64_t n, int32_t *out) {
    const int64_t k = read_u8(reader);
    int wide = 0;
    demand(k <= MOST_SHIFT, "bad-rice");
    if (!n) return;
    read_quotients(reader, n, out);
    const int64_t size = (n * k + 7) / 8, fill = 8 * size - n * k;
    const uint8_t *low = read_bytes(reader, size);
    demand(!fill || !(low[size - 1] & ((1 << fill) - 1)), "bad-rice");
    for (int64_t i = 0; i < n; i++) {
        const uint64_t m = (uint64_t)out[i] << k | bits_at(low, i * k, k);
        wide |= m >> 32 != 0;
        out[i] = (int32_t)(m & 1 ? -(int64_t)(m >> 1) - 1 : (int64_t)(m >> 1));
    }
    demand(!wide, "bad-rice");
}

void read_shifted(Reader *reader, int64_t n, int32_t *out) {
    const int64_t shift = read_u8(reader);
    int wide = 0;
    demand(shift <= MOST_SHIFT, "bad-rice");
    read_rice(reader, n, out);
    for (int64_t i = 0; i < n; i++) {
        const int64_t value = (int64_t)out[i] * ((int64_t)1 << shift);
        wide |= value >= 1ll << 31 || value <= -(1ll << 31);
        out[i] = (int32_t)value;
    }
    demand(!wide, "bad-rice");
}

void read_end(const Reader *reader) { demand(reader->at == reader->length, "payload-long"); }
