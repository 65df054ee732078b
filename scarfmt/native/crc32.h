/* CRC-32 as zlib computes it (SPEC 5.6), eight bytes at a time. */

#ifndef SCAR_CRC32_H
#define SCAR_CRC32_H

#include "kernel.h"

#define CRC_SLICES 8

typedef uint32_t CrcTable[CRC_SLICES][256];

static inline void crc32_table(CrcTable table) {
    for (uint32_t byte = 0; byte < 256; byte++) {
        uint32_t crc = byte;
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
        table[0][byte] = crc;
    }
    for (int slice = 1; slice < CRC_SLICES; slice++)
        for (uint32_t byte = 0; byte < 256; byte++)
            table[slice][byte] = table[slice - 1][byte] >> 8 ^ table[0][table[slice - 1][byte] & 255];
}

/* A u32 of a file, whatever the order of bytes here. */
static inline uint32_t little32(const uint8_t *at) {
    return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static inline uint32_t crc32_of(CrcTable table, const uint8_t *at, int64_t length) {
    uint32_t crc = ~0u;
    for (; length >= CRC_SLICES; length -= CRC_SLICES, at += CRC_SLICES) {
        const uint32_t low = crc ^ little32(at), high = little32(at + 4);
        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][high & 255] ^ table[2][high >> 8 & 255] ^ table[1][high >> 16 & 255] ^ table[0][high >> 24];
    }
    for (; length--; at++) crc = crc >> 8 ^ table[0][(crc ^ *at) & 255];
    return ~crc;
}

#endif
