/* The calls of scar.h: each enters with the state of the thread that makes it, and ends early where something is refused. */

#include "scar.h"

#include <string.h>

#include "gaussians.h"

THREAD Scar *current;

#if defined(__wasm__)

/* A trap ends the call, and what was worked on is given back by the next one: whoever called sees what fault.c kept. */
#define GUARDED(scar, failed) enter(scar)

#else

#include <stdlib.h>

#define GUARDED(scar, failed) \
    enter(scar);              \
    if (setjmp(current->out)) return failed

_Noreturn void refuse(const char *id) {
    current->refusal = id;
    longjmp(current->out, 1);
}

void *memory_take(int64_t bytes) {
    void *at = bytes < 0 || bytes > MOST_BYTES ? NULL : malloc((size_t)bytes + 1);
    if (!at) refuse("limit-memory");
    return at;
}

void memory_give(void *memory) { free(memory); }

const char *scar_refusal(Scar *scar) {
    const char *id = scar->refusal;
    scar->refusal = NULL;
    return id;
}

#endif

static void enter(Scar *scar) {
    current = scar;
    if (scar->working) memory_give(scar->working);
    scar->working = NULL;
}

/* A Scar of nothing; NULL without memory. */
static Scar *new_scar(Model *model) {
#if defined(__wasm__)
    Scar *scar = memory_take(sizeof *scar);
#else
    Scar *scar = malloc(sizeof *scar);
#endif
    if (scar) memset(scar, 0, sizeof *scar), scar->model = model;
    return scar;
}

Scar *scar_open(int32_t profile, int32_t sh_degree, int32_t slots, int32_t lattice_bits, double file_length, double x,
                double y, double z, double voxel) {
    Scar *scar = new_scar(NULL);
    if (!scar) return NULL;
    GUARDED(scar, scar);
    fill_crc_table();
    demand((profile == EXPLICIT || profile == ANCHOR) && sh_degree >= 0 && sh_degree <= 3, "bad-profile");
    demand(slots >= 1 && slots <= 32 && lattice_bits >= 1 && lattice_bits <= 32, "bad-slots");
    scar->model = memory_take(sizeof *scar->model), scar->owner = 1;
    *scar->model = (Model){.profile = profile, .sh_degree = sh_degree, .slots = slots, .lattice_bits = lattice_bits,
                           .origin = {x, y, z}, .voxel = voxel,
                           .numbers_left = FREE_NUMBERS + NUMBERS_PER_BYTE * (int64_t)file_length};
    return scar;
}

Scar *scar_share(Scar *first) { return new_scar(first->model); }

void scar_close(Scar *scar) {
    enter(scar);
    pool_empty(&scar->layer, 0);
    pool_empty(&scar->channel, 0);
    if (scar->owner) forget_model(scar->model);
    memory_give(scar);
    current = NULL;
}

int32_t scar_block(Scar *scar, int32_t k, int32_t kind, const uint8_t *bytes, int32_t length) {
    GUARDED(scar, -1);
    Model *m = scar->model;
    demand(m != NULL && k >= 1 && k <= MOST_FILE_LAYERS && kind >= 1 && kind < BLOCK_KINDS, "entry-kind");
    uint8_t *copy = memory_take((uint32_t)length);
    memcpy(copy, bytes, (uint32_t)length);
    memory_give((void *)m->blocks[k][kind].bytes);
    m->blocks[k][kind] = (Body){copy, (uint32_t)length};
    return 0;
}

int32_t scar_models(Scar *scar, int32_t from, int32_t to) {
    GUARDED(scar, -1);
    demand(scar->model != NULL, "missing-block");
    pool_empty(&layer_scratch, 1);
    read_models(scar->model, from, to);
    return 0;
}

TileState *scar_tile(Scar *scar, int32_t depth, int32_t shift, uint32_t prefix_low, uint32_t prefix_high) {
    GUARDED(scar, NULL);
    return new_tile(scar->model, depth, shift, (uint64_t)prefix_high << 32 | prefix_low);
}

TileState *scar_advance(Scar *scar, TileState *tile, const uint8_t *bytes, int32_t length, int32_t appear,
                        int32_t streams) {
    GUARDED(scar, NULL);
    scar->working = tile;
    pool_empty(&layer_scratch, 1);
    advance_tile(scar->model, tile, (Body){bytes, (uint32_t)length}, appear, streams);
    tile = scar->working, scar->working = NULL;
    return tile;
}

void scar_release(TileState *tile) { memory_give(tile); }

int32_t scar_tile_count(const TileState *tile) { return (int32_t)tile->known; }
int32_t scar_tile_layer(const TileState *tile) { return (int32_t)tile->layer; }

const void *scar_values(Scar *scar, const TileState *tile, int32_t what, int32_t channel) {
    GUARDED(scar, NULL);
    const Model *m = scar->model;
    if (what >= SCAR_POSITIONS) pool_empty(&layer_scratch, 1);
    switch (what) {
        case SCAR_CODES: return tile->codes;
        case SCAR_CLASSES: return tile->classes;
        case SCAR_INTEGERS: return tile->values[channel];
        case SCAR_INDICES: return tile->indices;
        case SCAR_SLOTS: return tile->slots;
        case SCAR_POSITIONS: return exact_positions(m, tile, &layer_scratch);
        case SCAR_VALUES: return exact_values(m, tile, channel, &layer_scratch);
        case SCAR_SUMS: return has_decoder(m, tile) ? exact_sums(m, tile, &layer_scratch) : NULL;
        case SCAR_LATENTS: return has_decoder(m, tile) ? exact_latents(m, tile, &layer_scratch) : NULL;
        default: return NULL;
    }
}

const Gaussians *scar_gaussians(Scar *scar, const TileState *tile, double x, double y, double z, int32_t drawn) {
    GUARDED(scar, NULL);
    pool_empty(&layer_scratch, 1);
    Gaussians *out = pool_take(&layer_scratch, sizeof *out);
    const double eye[3] = {x, y, z};
    if (scar->model->profile == ANCHOR) bake_slots(scar->model, tile, eye, drawn, &layer_scratch, out);
    else activate(scar->model, tile, &layer_scratch, out);
    return out;
}

int32_t scar_model_number(Scar *scar, int32_t what, int32_t which) {
    const Model *m = scar->model;
    const GridLevel *level = m->grid.level + which;
    switch (what) {
        case SCAR_CHANNELS: return (int32_t)m->channels;
        case SCAR_STREAM: return (int32_t)m->channel[which].stream;
        case SCAR_COMPONENTS: return (int32_t)m->channel[which].components;
        case SCAR_DIMS: return m->decoder.layers ? (int32_t)m->decoder.layer[0].columns : 0;
        case SCAR_STAGES: return (int32_t)m->most_stages;
        case SCAR_BOOK_SIZE: return (int32_t)m->books[which].size;
        case SCAR_GRID_LEVELS: return (int32_t)m->grid.levels;
        case SCAR_GRID_BITS: return (int32_t)grid_bits(level);
        case SCAR_GRID_FEATURES: return (int32_t)level->features;
        case SCAR_DECODER_OUTPUTS: return m->decoder.layers ? (int32_t)m->decoder.layer[m->decoder.layers - 1].rows : 0;
        default: return 0;
    }
}

const int32_t *scar_model_words(Scar *scar, int32_t book) { return scar->model->books[book].words; }
const uint8_t *scar_model_bits(Scar *scar, int32_t level) { return scar->model->grid.level[level].bits; }

#if !defined(__wasm__)
int32_t scar_interface(void) { return SCAR_INTERFACE; }

double scar_work(Scar *scar, const int64_t *tiles, int64_t anchors, int64_t splits) {
    return declared_work(scar->model, tiles, anchors, splits);
}

int32_t scar_scene(Scar *scar, const TileState *tile, const SceneRows *out) {
    GUARDED(scar, -1);
    pool_empty(&layer_scratch, 1);
    put_scene(scar->model, tile, &layer_scratch, out);
    return 0;
}
#endif
