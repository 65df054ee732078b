/* Reading the fields of a payload in order (SPEC 5.7). */

#ifndef SCAR_PAYLOAD_H
#define SCAR_PAYLOAD_H

#include "fault.h"
#include "kernel.h"

typedef struct {
    const uint8_t *bytes;
    int64_t length, at;
} Reader;

/* The next n bytes: refuses payload-short. */
const uint8_t *read_bytes(Reader *reader, int64_t n);
uint8_t read_u8(Reader *reader);
uint32_t read_u32(Reader *reader);

/* That the payload is used up: refuses payload-long. */
void read_end(const Reader *reader);

#endif
