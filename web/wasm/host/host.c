/* The glue and the kernel on the machine at hand, for sanitizers and for comparison: `host FILE [RUNS]` decodes a file
from the first layer to the last and prints the id of its refusal, or a checksum of all integers and processor time.
What is checked of header, ROOT and pages is no more than what keeps it from reading elsewhere: files are refused
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
#define TILE_KIND 16
#define DEEPEST 21
#define MOST_PAGE_BITS 16
#define MOST_TILES (1 << 20)
#define LEAST_ENTRY 8

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

/* A block; `tile` is -1 of one that belongs to none. */
typedef struct {
    int64_t kind, tile, offset, length;
    uint32_t count;
} Entry;

typedef struct {
    uint8_t depth, shift;
    uint64_t prefix;
} Cube;

typedef struct {
    int64_t tile_bytes, row_bytes[MOST_FILE_LAYERS];
    uint64_t base;
} Page;

typedef struct {
    const uint8_t *bytes;
    int64_t length, layers, tiles, page_size, pages;
    Page *page;
    Cube *cube;
    Entry *model;       /* of no tile, `models` of them, with the layer of each */
    int64_t *layer_of, models;
    Entry *row;         /* (layers, tiles); of length 0 where there is none */
} File;

static uint64_t little64(const uint8_t *at) { return little32(at) | (uint64_t)little32(at + 4) << 32; }

static double number(const uint8_t *at) {
    double out;
    memcpy(&out, at, sizeof out);
    return out;
}

typedef struct {
    const uint8_t *at, *end;
} Cursor;

static const uint8_t *skip(Cursor *c, int64_t n) {
    demand(n >= 0 && n <= c->end - c->at, "payload-short");
    c->at += n;
    return c->at - n;
}

static Cursor part(Cursor *c, int64_t n) {
    const uint8_t *start = skip(c, n);
    return (Cursor){start, start + n};
}

static uint64_t varint(Cursor *c) {
    uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
        const uint8_t byte = *skip(c, 1);
        value |= (uint64_t)(byte & 127) << shift;
        if (byte < 128) return value;
    }
    refuse("bad-varint");
}

/* Lengths that no file has are refused, so that sums of a few of them stay small. */
static int64_t bytes_of(Cursor *c, const File *f) {
    const uint64_t length = varint(c);
    demand(length <= (uint64_t)f->length, "entry-length");
    return (int64_t)length;
}

static void read_root(File *f, Cursor *c) {
    f->models = 0;
    for (int64_t k = 1; k <= f->layers; k++)
        for (uint64_t left = varint(c); left; left--) {
            demand(f->models < f->length / LEAST_ENTRY, "payload-short");
            Entry *e = &f->model[f->models];
            f->layer_of[f->models++] = k;
            e->kind = *skip(c, 2), e->tile = -1, e->length = bytes_of(c, f), e->count = (uint32_t)varint(c);
            skip(c, 4);
        }
    for (int64_t p = 0; p < f->pages; p++) {
        Page *page = &f->page[p];
        page->base = (p ? f->page[p - 1].base : 0) + varint(c), page->tile_bytes = bytes_of(c, f);
        skip(c, 4);
        for (int64_t k = 0; k < f->layers; k++) {
            page->row_bytes[k] = bytes_of(c, f);
            if (!page->row_bytes[k]) continue;
            skip(c, 4);
            varint(c);
            varint(c);
        }
    }
}

static void read_tile_page(File *f, int64_t first, int64_t n, uint64_t past, Cursor c) {
    const uint8_t *depth = skip(&c, n), *shift = skip(&c, n);
    for (int64_t i = 0; i < n; i++) {
        demand(depth[i] <= DEEPEST && shift[i] < 32, "tile-depth");
        const int free = 3 * (DEEPEST - depth[i]);
        const uint64_t prefix = ((past + (1ull << free) - 1) >> free) + varint(&c);
        f->cube[first + i] = (Cube){depth[i], shift[i], prefix};
        past = (prefix + 1) << free;
    }
}

static void read_row_page(Entry *row, int64_t n, const File *f, Cursor c) {
    for (int64_t i = 0; i < n; i++) row[i].length = bytes_of(&c, f);
    for (int64_t i = 0; i < n; i++)
        if (row[i].length) row[i].count = (uint32_t)varint(&c);
}

/* Where blocks lie: by layer, kind and tile. */
static void place(File *f, int64_t at) {
    int64_t m = 0;
    for (int64_t k = 1; k <= f->layers; k++) {
        Entry *row = f->row + (k - 1) * f->tiles;
        int tiles_placed = 0;
        while (!tiles_placed || (m < f->models && f->layer_of[m] == k)) {
            if (m < f->models && f->layer_of[m] == k && (tiles_placed || f->model[m].kind < TILE_KIND)) {
                f->model[m].offset = at, at += f->model[m].length, m++;
                continue;
            }
            for (int64_t tile = 0; tile < f->tiles; tile++) row[tile].offset = at, at += row[tile].length;
            tiles_placed = 1;
        }
        demand(at >= 0 && at <= f->length, "layer-offset");
    }
}

static void read_directory(File *f) {
    demand(f->length >= FIXED, "truncated-header");
    f->layers = f->bytes[26], f->tiles = little32(f->bytes + 32);
    demand(f->layers >= 1 && f->layers <= MOST_FILE_LAYERS, "bad-layer-count");
    demand(f->bytes[31] <= MOST_PAGE_BITS && f->tiles <= MOST_TILES, "limit-tiles");
    f->page_size = 1ll << f->bytes[31], f->pages = (f->tiles + f->page_size - 1) / f->page_size;
    f->page = calloc((size_t)f->pages + 1, sizeof *f->page), f->cube = calloc((size_t)f->tiles + 1, sizeof *f->cube);
    f->row = calloc((size_t)(f->layers * f->tiles + 1), sizeof *f->row);
    f->model = calloc((size_t)(f->length / LEAST_ENTRY + 1), sizeof *f->model);
    f->layer_of = calloc((size_t)(f->length / LEAST_ENTRY + 1), sizeof *f->layer_of);
    Cursor c = {f->bytes, f->bytes + f->length};
    skip(&c, FIXED + SUMMARY * f->layers + 4);
    Cursor root = part(&c, little32(f->bytes + 36));
    read_root(f, &root);
    for (int64_t k = 0; k <= f->layers; k++)
        for (int64_t p = 0; p < f->pages; p++) {
            const int64_t first = p * f->page_size, left = f->tiles - first;
            const int64_t n = left < f->page_size ? left : f->page_size;
            const int64_t size = k ? f->page[p].row_bytes[k - 1] : f->page[p].tile_bytes;
            const Cursor page = part(&c, size);
            if (!k) read_tile_page(f, first, n, f->page[p].base, page);
            else if (size) read_row_page(f->row + (k - 1) * f->tiles + first, n, f, page);
        }
    place(f, c.at - f->bytes);
}

static void read_models(const File *f) {
    scar_open(f->bytes[24], f->bytes[25], f->bytes[27], f->bytes[28], (double)f->length, number(f->bytes + 56),
              number(f->bytes + 64), number(f->bytes + 72), number(f->bytes + 80));
    for (int64_t m = 0; m < f->models; m++) {
        const Entry *e = &f->model[m];
        if (!e->kind || e->kind >= BLOCK_KINDS) continue;
        uint8_t *copy = memory_take(e->length);
        memcpy(copy, f->bytes + e->offset, (size_t)e->length);
        scar_block((int32_t)f->layer_of[m], (int32_t)e->kind, copy, (int32_t)e->length);
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

/* All tiles; adds processor seconds of decoding, and of activation, and what was decoded. */
static void read_tiles(const File *f, double seconds[2], int64_t *anchors, uint64_t *sum) {
    for (int64_t tile = 0; tile < f->tiles; tile++) {
        const Cube *cube = &f->cube[tile];
        TileState *state = scar_tile(cube->depth, cube->shift, (uint32_t)cube->prefix, (uint32_t)(cube->prefix >> 32));
        const clock_t start = clock();
        for (int64_t k = 0; k < f->layers; k++) {
            const Entry *row = &f->row[k * f->tiles + tile];
            const uint8_t *block = row->length ? f->bytes + row->offset : NULL;
            state = scar_advance(state, block, (int32_t)row->length, (int32_t)row->count);
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
    read_directory(&f);
    read_models(&f);
    for (int run = 0; run < runs; run++) {
        double seconds[2] = {0, 0};
        sum = 0, anchors = 0;
        read_tiles(&f, seconds, &anchors, &sum);
        for (int i = 0; i < 2; i++) least[i] = seconds[i] < least[i] ? seconds[i] : least[i];
    }
    printf("%016llx %lld anchors, integers %.3f us, values %.3f us each\n", (unsigned long long)sum, (long long)anchors,
           1e6 * least[0] / (double)anchors, 1e6 * least[1] / (double)anchors);
    return 0;
}
