/* A tile as far as it is decoded, and what it is decoded with. */

#ifndef SCAR_WASM_TILE_H
#define SCAR_WASM_TILE_H

#include "model.h"
#include "scar.h"
#include "steps.h"

#if !defined(__wasm__)
#include <setjmp.h>
#endif

/* Integers of the anchors known, in their order (SPEC 6.3). All of it is one block of memory. */
struct TileState {
    int64_t layer, known, stages;          /* stages: columns of indices */
    int64_t depth, shift, bits, corner[3]; /* corner: in lattice steps */
    int64_t appeared[MOST_FILE_LAYERS + 1];
    uint64_t *codes;
    uint8_t *classes;
    int32_t *values[MOST_CHANNELS]; /* (components, known); of OFFSETS (known, slots, 3) */
    int16_t *indices;               /* (known, stages) */
    uint8_t *slots;                 /* (known, slots) layer that turned it on, 0 for none; NULL: explicit profile */
};

/* One layer of a tile while it is read. */
typedef struct {
    const Model *m;
    const LayerModel *layer;
    TileState *t;
    int64_t streams;                /* bits of the sub-streams to read */
    int64_t k, new;                 /* new: anchors that appear, the last of those known */
    Body parts[STREAM_KINDS];
    int32_t *symbols, *order;       /* scratch: as many as anchors, or slots, or components of all anchors */
    int32_t *chosen;                /* scratch: as many as anchors */
    uint16_t *kinds;
    int64_t *counts;
    int64_t *by_code;               /* anchors by code, then index; NULL until they are wanted */
    int32_t *cell[MOST_DEPTHS];
    int64_t sizes[MOST_DEPTHS];     /* of cells; named with by_code */
    int32_t *settled;               /* (known, attributes) fine values; NULL where nothing looks at them */
    int64_t settled_columns;
} Work;

/* One thread's work with the models of a file. */
struct Scar {
    Model *model;
    int owner;            /* whether it gives the models back */
    Pool layer, channel;  /* memory until the next layer of a tile, or the next question about one; until the next channel */
    TileState *working;   /* what the call works on: given back if it is refused */
    const char *refusal;
#if !defined(__wasm__)
    jmp_buf out;
#endif
};

/* The one whose call runs. */
extern THREAD Scar *current;
#define layer_scratch (current->layer)
#define channel_scratch (current->channel)

TileState *new_tile(const Model *m, int64_t depth, int64_t shift, uint64_t prefix);

/* One layer of a tile, which is current->working then; `streams`: bits of what is read beside positions, classes, masks. */
void advance_tile(const Model *m, TileState *tile, Body block, int64_t appear, int64_t streams);

/* Every third bit of a Morton code, from bit 0 on, as a coordinate (SPEC 6.2). */
INLINE int64_t coordinate(uint64_t code) {
    code &= 0x1249249249249249;
    code = (code ^ code >> 2) & 0x10C30C30C30C30C3;
    code = (code ^ code >> 4) & 0x100F00F00F00F00F;
    code = (code ^ code >> 8) & 0x001F0000FF0000FF;
    code = (code ^ code >> 16) & 0x001F00000000FFFF;
    return (int64_t)((code ^ code >> 32) & 0x1FFFFF);
}

TileState *grown_tile(const Model *m, TileState *old, int64_t new);

/* Sub-streams (SPEC 7.1). */
void fill_crc_table(void);
void find_parts(Work *w, Body block);

/* Streams of any block (SPEC 8.2). */
const char *open_words(Body bytes, Rans *out); /* what they break, or NULL */
Rans open_stream(Body bytes);
void seal_stream(const Rans *rans);

/* n values by their kinds, into w->symbols. */
void read_kinds(Work *w, Rans *rans, const Tables *tables, const uint16_t *kinds, int64_t n);

/* Finds by_code, and the cells of the decoded context (SPEC 10.2). */
void look_at_cells(Work *w);
Cells cells_of(const Work *w, Pool *pool, int64_t columns);

void read_channels(Work *w);
void read_static_channels(const Work *w, int64_t *channels, int64_t count); /* orders the channels */
void read_network_indices(Work *w, Rans *rans);

/* Numbers by class, anchor by anchor. */
int64_t *by_anchor(const Work *w, Pool *pool, const int64_t *by_class);

#endif
