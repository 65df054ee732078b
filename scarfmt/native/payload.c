#include "payload.h"

#include <string.h>

#include "crc32.h"

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

void read_end(const Reader *reader) { demand(reader->at == reader->length, "payload-long"); }
