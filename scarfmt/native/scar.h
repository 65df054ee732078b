/* libscar: the models and tiles of .scar files (SPEC 5 to 10), for one program in C, for Python and for WebAssembly.

Whoever calls reads the header, the directory and the bytes of blocks, and checks the checksums of whole blocks. What breaks
a rule is refused: the call returns NULL or -1 (in WebAssembly it traps), and scar_refusal tells the id of SPEC 12.1. A Scar
serves one thread at a time; others of the same models come from scar_share. */

#ifndef SCAR_H
#define SCAR_H

#include <stdint.h>

#include "compiler.h"

#define SCAR_INTERFACE 10 /* grows with every change of what is declared here: Python loads no other */

typedef struct Scar Scar;
typedef struct TileState TileState;

/* Numbers of a tile after its layer, n anchors in the order of SPEC 6.3. */
enum {
    SCAR_CODES,     /* (n) uint64 */
    SCAR_CLASSES,   /* (n) uint8 */
    SCAR_INTEGERS,  /* of a channel: (components, n) int32; of OFFSETS (n, slots, 3) */
    SCAR_INDICES,   /* (n, stages) int16 */
    SCAR_SLOTS,     /* (n, slots) uint8 layer that turned each on, 0 for none; NULL in the explicit profile */
    SCAR_POSITIONS, /* (n, 3) double (SPEC 9.1) */
    SCAR_VALUES,    /* of a channel: (n, components) float (SPEC 9.2); of OFFSETS (n, slots, 3) */
    SCAR_SUMS,      /* (n, dims) int32 sums of codewords (R-9.2-2); NULL without DECODER_MLP */
    SCAR_LATENTS    /* (n, dims) float; NULL without DECODER_MLP */
};

/* Numbers of the models. */
enum {
    SCAR_CHANNELS, SCAR_STREAM, SCAR_COMPONENTS, SCAR_DIMS, SCAR_STAGES, SCAR_BOOK_SIZE, SCAR_GRID_LEVELS, SCAR_GRID_BITS,
    SCAR_GRID_FEATURES, SCAR_DECODER_OUTPUTS
};

/* `count` Gaussians in binary32, as renderers take them. harmonics: (count, coefficients, 3); features: (anchors, outputs of
DECODER_MLP) of the anchor profile. */
typedef struct {
    int32_t count, coefficients;
    float *centres, *scales, *quaternions, *opacity, *harmonics;
    float *features;
} Gaussians;

/* Room for the n Gaussians of a tile as scene files hold them: logarithms of scales, logits of opacities. */
typedef struct {
    double *positions;                                     /* (n, 3) */
    float *log_scales, *quaternions, *logits, *harmonics; /* (n, 3), (n, 4), (n), (n, coefficients, 3) */
} SceneRows;

/* What a header says. Returns NULL only without memory. */
EXPORT Scar *scar_open(int32_t profile, int32_t sh_degree, int32_t slots, int32_t lattice_bits, double file_length,
                       double x, double y, double z, double voxel);
/* Another Scar of the same models, to be closed before the first one. */
EXPORT Scar *scar_share(Scar *first);
EXPORT void scar_close(Scar *scar);

/* Copies a model block of layer k; and reads the models of layers from..to, whose blocks were given. */
EXPORT int32_t scar_block(Scar *scar, int32_t k, int32_t kind, const uint8_t *bytes, int32_t length);
EXPORT int32_t scar_models(Scar *scar, int32_t from, int32_t to);

/* A tile of which nothing is decoded, by its record in the tile table (SPEC 5.4). */
EXPORT TileState *scar_tile(Scar *scar, int32_t depth, int32_t shift, uint32_t prefix_low, uint32_t prefix_high);
/* Takes a tile to its next layer by the block of that layer; length 0: it has none. appear: anchors that first appear in
it. streams: bits of the sub-streams to read beside positions, classes and masks, with all that these look at; the bytes of
others do not matter. Returns the tile, which lies elsewhere now; where the call is refused it is gone. */
EXPORT TileState *scar_advance(Scar *scar, TileState *tile, const uint8_t *bytes, int32_t length, int32_t appear,
                               int32_t streams);
EXPORT void scar_release(TileState *tile);

EXPORT int32_t scar_tile_count(const TileState *tile);
EXPORT int32_t scar_tile_layer(const TileState *tile);
/* Numbers of a tile; those from SCAR_POSITIONS on are valid until the next call. */
EXPORT const void *scar_values(Scar *scar, const TileState *tile, int32_t what, int32_t channel);
/* The Gaussians of a tile, valid until the next call. The camera centre matters to the anchor profile alone, and whether only
what is drawn is wanted: what is not then has opacity 0, and colours are coefficients of degree 0. */
EXPORT const Gaussians *scar_gaussians(Scar *scar, const TileState *tile, double x, double y, double z, int32_t drawn);

EXPORT int32_t scar_model_number(Scar *scar, int32_t what, int32_t which);
EXPORT const int32_t *scar_model_words(Scar *scar, int32_t book); /* of a codebook */
EXPORT const uint8_t *scar_model_bits(Scar *scar, int32_t level); /* of the hash grid */

/* The id of the refusal that ended the last call, NULL for none; it is then forgotten. */
EXPORT const char *scar_refusal(Scar *scar);

#if !defined(__wasm__)
extern EXPORT int32_t scar_interface(void);
/* The work of SPEC 13.2 for so many tiles that have anchors after each layer, so many anchors and splits of nodes; -1 where
networks code symbols, whose work only the definition counts. */
extern EXPORT double scar_work(Scar *scar, const int64_t *tiles, int64_t anchors, int64_t splits);
/* The rows of a tile of the explicit profile. */
extern EXPORT int32_t scar_scene(Scar *scar, const TileState *tile, const SceneRows *out);
#endif

#endif
