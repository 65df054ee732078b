/* The glue and the kernel on the machine at hand, for sanitizers and for comparison: `host FILE [RUNS]` decodes a file
from the first layer to the last and prints the id of its refusal, or a checksum of all integers and processor time.
What is checked of header and directory is no more than what keeps it from reading elsewhere: files are refused
properly by those who open them for the module. */

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "crc32.h"
#include "fault.h"
#include "gaussians.h"
#include "memory.h"
#include "tile.h"

#define FIXED 100
#define SUMMARY 136
#define TILE_BYTES 12
#define ENTRY_BYTES 32
#define TILE_KIND 16

void scar_open(int32_t profile, int32_t sh_degree, int32_t slots, int32_t lattice_bits, double file_length, double x,
               double y, double z, double voxel);
void scar_block(int32_t k, int32_t kind, uint8_t *bytes, int32_t length);
void scar_models(int32_t from, int32_t to);
TileState *scar_tile(int32_t depth, int32_t shift, uint32_t prefix_low, uint32_t prefix_high);
TileState *scar_advance(TileState *tile, const uint8_t *bytes, int32_t length, int32_t appear);
void scar_release(TileState *t);
const Gaussians *scar_gaussians(const TileState *t, double x, double y, double z, int32_t drawn);

static jmp_buf refused;
static const char *refusal;

_Noreturn void refuse(const char *id) {
    refusal = id;
    longjmp(refused, 1);
}

void *memory_take(int64_t bytes) {
    void *at = bytes < 0 || bytes > MOST_BYTES ? NULL : malloc((size_t)bytes + 1);
    if (!at) refuse("limit-memory");
    return at;
}

void memory_give(void *memory) { free(memory); }

typedef struct {
    const uint8_t *bytes;
    int64_t length, layers, tiles, entries;
} File;

static uint64_t little64(const uint8_t *at) { return little32(at) | (uint64_t)little32(at + 4) << 32; }

static double number(const uint8_t *at) {
    double out;
    memcpy(&out, at, sizeof out);
    return out;
}

static const uint8_t *tile_record(const File *f, int64_t tile) {
    return f->bytes + FIXED + SUMMARY * f->layers + 4 + TILE_BYTES * tile;
}

static const uint8_t *entry(const File *f, int64_t e) { return tile_record(f, f->tiles) + ENTRY_BYTES * e; }

static void check_file(File *f) {
    demand(f->length >= FIXED, "truncated-header");
    f->layers = f->bytes[26], f->tiles = little32(f->bytes + 32), f->entries = little32(f->bytes + 36);
    demand(f->layers >= 1 && f->layers <= MOST_FILE_LAYERS, "bad-layer-count");
    demand(entry(f, f->entries) - f->bytes <= f->length, "truncated-directory");
    for (int64_t e = 0; e < f->entries; e++) {
        const uint64_t offset = little64(entry(f, e) + 8), length = little64(entry(f, e) + 16);
        demand(offset <= (uint64_t)f->length && length <= (uint64_t)f->length - offset, "entry-offset");
        demand(entry(f, e)[2] >= 1 && entry(f, e)[2] <= f->layers, "entry-layer");
    }
}

static void read_models(const File *f) {
    scar_open(f->bytes[24], f->bytes[25], f->bytes[27], f->bytes[28], (double)f->length, number(f->bytes + 56),
              number(f->bytes + 64), number(f->bytes + 72), number(f->bytes + 80));
    for (int64_t e = 0; e < f->entries; e++) {
        const uint8_t *record = entry(f, e);
        if (!record[0] || record[0] >= BLOCK_KINDS) continue;
        const int64_t length = (int64_t)little64(record + 16);
        uint8_t *copy = memory_take(length);
        memcpy(copy, f->bytes + little64(record + 8), (size_t)length);
        scar_block(record[2], record[0], copy, (int32_t)length);
    }
    scar_models(1, (int32_t)f->layers);
}

static uint64_t mixed(uint64_t sum, const void *bytes, int64_t length) {
    for (int64_t i = 0; i < length; i++) sum = (sum ^ ((const uint8_t *)bytes)[i]) * 0x100000001B3;
    return sum;
}

static uint64_t checksum(const TileState *t) {
    uint64_t sum = mixed(0xcbf29ce484222325, t->codes, 8 * t->known);
    sum = mixed(sum, t->indices, 2 * t->known * t->stages);
    for (int64_t c = 0; c < the_model.channels; c++)
        sum = mixed(sum, t->values[c], 4 * t->known * the_model.channel[c].components);
    return sum;
}

/* Entries of TILE blocks by (layer, tile), -1 for none. */
static int64_t *tile_entries(const File *f) {
    int64_t *found = malloc(8 * (size_t)(f->layers * f->tiles + 1));
    for (int64_t i = 0; i < f->layers * f->tiles; i++) found[i] = -1;
    for (int64_t e = 0; e < f->entries; e++) {
        const uint8_t *record = entry(f, e);
        const int64_t tile = little32(record + 4);
        if (record[0] == TILE_KIND && tile < f->tiles) found[(record[2] - 1) * f->tiles + tile] = e;
    }
    return found;
}

/* All tiles; adds processor seconds of decoding, and of activation, and what was decoded. */
static void read_tiles(const File *f, const int64_t *entries, double seconds[2], int64_t *anchors, uint64_t *sum) {
    for (int64_t tile = 0; tile < f->tiles; tile++) {
        const uint8_t *record = tile_record(f, tile);
        TileState *state = scar_tile(record[0], record[1], little32(record + 4), little32(record + 8));
        const clock_t start = clock();
        for (int64_t k = 0; k < f->layers; k++) {
            const int64_t e = entries[k * f->tiles + tile];
            const uint8_t *block = e < 0 ? NULL : f->bytes + little64(entry(f, e) + 8);
            state = scar_advance(state, block, e < 0 ? 0 : (int32_t)little64(entry(f, e) + 16),
                                 e < 0 ? 0 : (int32_t)little32(entry(f, e) + 24));
        }
        const clock_t decoded = clock();
        const Gaussians *gaussians = scar_gaussians(state, 0, 0, 0, 1);
        seconds[0] += (double)(decoded - start) / CLOCKS_PER_SEC;
        seconds[1] += (double)(clock() - decoded) / CLOCKS_PER_SEC;
        *anchors += state->known;
        *sum = mixed(*sum ^ checksum(state), gaussians->centres, 12 * (int64_t)gaussians->count);
        scar_release(state);
    }
}

static uint8_t *whole(const char *path, int64_t *length) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END)) return NULL;
    *length = ftell(file);
    uint8_t *bytes = malloc((size_t)*length + 1);
    rewind(file);
    if (fread(bytes, 1, (size_t)*length, file) != (size_t)*length) return NULL;
    fclose(file);
    return bytes;
}

int main(int count, char **arguments) {
    File f = {0};
    const int runs = count > 2 ? atoi(arguments[2]) : 1;
    if (count < 2 || !(f.bytes = whole(arguments[1], &f.length))) return 2;
    double least[2] = {1e9, 1e9};
    uint64_t sum = 0;
    int64_t anchors = 0;
    if (setjmp(refused)) {
        printf("%s\n", refusal);
        return 0;
    }
    check_file(&f);
    read_models(&f);
    int64_t *entries = tile_entries(&f);
    for (int run = 0; run < runs; run++) {
        double seconds[2] = {0, 0};
        sum = 0, anchors = 0;
        read_tiles(&f, entries, seconds, &anchors, &sum);
        for (int i = 0; i < 2; i++) least[i] = seconds[i] < least[i] ? seconds[i] : least[i];
    }
    free(entries);
    printf("%016llx %lld anchors, integers %.3f us, values %.3f us each\n", (unsigned long long)sum, (long long)anchors,
           1e6 * least[0] / (double)anchors, 1e6 * least[1] / (double)anchors);
    return 0;
}
