/* Finite state entropy and Huffman codes of Zstandard (RFC 8878, 4). */

#ifndef SCAR_ZSTD_TABLES_H
#define SCAR_ZSTD_TABLES_H

#include "fault.h"
#include "kernel.h"

#define FSE_STATES 512
#define HUFFMAN_STATES 2048

/* Bits of bytes from the last on, after a mark of one bit 1. `left` is below 0 once more are read than there are. */
typedef struct {
    const uint8_t *bytes;
    int64_t length, left;
} BackwardBits;

/* State s stands for symbol[s]; the next is base[s] plus bits[s] bits. log < 0: no table. */
typedef struct {
    int32_t log;
    uint8_t symbol[FSE_STATES], bits[FSE_STATES];
    uint16_t base[FSE_STATES];
} FseTable;

/* The next `log` bits, as an index, give a symbol and how many bits it takes. log 0: no table. */
typedef struct {
    int32_t log;
    uint8_t symbol[HUFFMAN_STATES], bits[HUFFMAN_STATES];
} HuffmanTable;

BackwardBits backward_bits(const uint8_t *bytes, int64_t length);
uint32_t backward_read(BackwardBits *bits, int64_t n);

/* Bytes that the description of a table took. */
int64_t read_fse(const uint8_t *bytes, int64_t length, int32_t most_log, int32_t most_symbol, FseTable *out);
void make_fse(const int16_t *counts, int32_t symbols, int32_t log, FseTable *out);

int64_t read_huffman(const uint8_t *bytes, int64_t length, HuffmanTable *out);

/* n symbols of one bit stream, which they use up. */
void huffman_stream(const HuffmanTable *table, const uint8_t *bytes, int64_t length, uint8_t *out, int64_t n);

#endif
