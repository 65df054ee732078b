/* A Zstandard decompressor (RFC 8878) for the frames of SPEC 5.8: one frame, content size stated, no dictionary, no
content checksum. */

#ifndef SCAR_ZSTD_H
#define SCAR_ZSTD_H

#include "memory.h"

typedef struct {
    const uint8_t *bytes;
    int64_t length;
} Content;

/* What a frame header says. */
typedef struct {
    int64_t content, window, at; /* at: where blocks begin */
} FrameHeader;

/* Refuses bad-zstd, content-limit above `most` bytes. */
FrameHeader zstd_header(const uint8_t *bytes, int64_t length, int64_t most);

/* The content of a frame whose header was read; it lies in `pool`. Refuses bad-zstd. */
Content zstd_content(const uint8_t *bytes, int64_t length, FrameHeader header, Pool *pool);

#endif
