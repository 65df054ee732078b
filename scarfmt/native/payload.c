#include "payload.h"

#include "crc32.h"

const uint8_t *read_bytes(Reader *reader, int64_t n) {
    const int64_t at = reader->at;
    demand(n <= reader->length - at, "payload-short");
    reader->at += n;
    return reader->bytes + at;
}

uint8_t read_u8(Reader *reader) { return *read_bytes(reader, 1); }

uint32_t read_u32(Reader *reader) { return little32(read_bytes(reader, 4)); }

void read_end(const Reader *reader) { demand(reader->at == reader->length, "payload-long"); }
