/* Structs that Python fills in: scarfmt/kernel/structs.py declares them again for ctypes, and layout.c tells it where
their fields lie, so that no library is used whose layout is another. */

#ifndef SCAR_STRUCTS_H
#define SCAR_STRUCTS_H

#include <stdint.h>

#define MOST_DEPTHS 4
#define MOST_HEADS 2
#define MOST_LAYERS 4
#define MOST_CHANNELS 8
#define MOST_STAGES 8
#define MOST_STEPS 20
#define CLASS_ROOM 16 /* classes: 15 at most */
#define STREAM_KINDS 12 /* sub-streams are of kinds 1..11 */
#define BLOCK 16 /* anchors worked on side by side */

typedef float Lanes __attribute__((vector_size(4 * BLOCK), aligned(4), may_alias));

/* A decoder's state and its words, of which the last is taken first (SPEC 8.2). */
typedef struct {
    uint64_t state;
    uint64_t left;
    const uint32_t *words;
} Rans;

/* Static tables by kind: number[k] of kind k's table, -1 for none. Table t has values[starts[t]..starts[t + 1] - 1],
and one prefix sum more, from sums[starts[t] + t] on. */
typedef struct {
    int64_t kinds;
    const int32_t *number;
    const int64_t *starts;
    const uint32_t *sums;
    const int32_t *values;
    uint8_t *used; /* per kind: set to 1 where a symbol was read */
} Tables;

/* The codewords of each cluster of a two-level head, transposed: cluster k has starts[k + 1] - starts[k] = m. Filled up
to a multiple of BLOCK, which is places[k + 1] - places[k] = w, with members that have no weight, it has the (width, w)
weights from weights[places[k] * width] on, and w offsets from offsets[places[k]] on. */
typedef struct {
    int64_t clusters, width, largest; /* largest: w of any */
    const int64_t *starts, *places;
    const float *weights, *offsets;
} Members;

/* Sums over the anchors of each cell, up to MOST_DEPTHS depths, coarse first. */
typedef struct {
    int64_t depths, columns;
    const int32_t *cell[MOST_DEPTHS]; /* per anchor (n), its cell at each depth */
    double *sums[MOST_DEPTHS];        /* (cells, columns + 1): sums, and in the last column the count */
    int64_t sizes[MOST_DEPTHS];       /* cells */
} Cells;

/* One component's part of a step. */
typedef struct {
    int64_t units, rows;             /* hidden units; rows of `weights`: units + 2, filled up to a multiple of ROWS */
    const float *weights, *biases;   /* (rows, shared + depths): hidden units, then the two direct rows; (units) */
    const float *output;             /* (2, units) */
    float output_biases[2];
    float last[2];                   /* buckets - 1 */
} Predictor;

/* Where a symbol's context comes from while there is no predictor (SPEC 8.4). */
typedef struct {
    int64_t by_class, low, shift;
    int64_t source, component, columns; /* number among `sources`, -1 for none; its component; how many it has */
} Rule;

/* One channel in one tile-layer of n anchors. */
typedef struct {
    int64_t count, components;
    const int64_t *classes;          /* (n) */
    int32_t *values;                 /* (n, components) before and after */
    int32_t *first;                  /* (n, components), written in step 1 */
    int64_t *steps;                  /* (n) steps that values are at */
    const Rule *rules;               /* (components) */
    const int32_t *const *sources;   /* first-step values of channels, (n, columns) each */
    const int32_t *settled;          /* (n, settled_stride) fine values, the first settled_columns are inputs */
    int64_t settled_columns, settled_stride;
    Cells cells;                     /* sums: scratch */
    float *inputs;                   /* scratch: (BLOCKs of the widest pass, width, BLOCK); one block beyond step 1 */
    uint16_t *kind;                  /* scratch: (components, widest pass) */
    int32_t *symbols, *order;        /* scratch, reading: as many each */
    int64_t *counts;                 /* scratch, reading: kinds + 1 of the tables of most kinds */
    /* Of one step: */
    int64_t step;
    const Predictor *predictors;     /* (components), those of 0 rows are none; NULL: none at all */
    const Tables *tables;
    const int32_t *given;            /* (n, components) values after the step, to be written; NULL to read them */
    uint16_t *kinds_out;             /* writing: kinds and symbols, (anchors of all passes * components), */
    int32_t *symbols_out;            /* pass by pass and, in step 1, component by component */
} Channel;

/* What a layer brings of a channel. */
typedef struct {
    int64_t start, stop;                 /* the steps that some anchor may receive; stop: the one after */
    const int64_t *before, *after;       /* (n) steps before and after the layer */
    const int64_t *by_code;              /* (n) anchors by code, then index; NULL where nothing is predicted */
    int64_t passes_log2;
    const Tables *const *tables;         /* a step */
    const Predictor *const *predictors;  /* a step, or NULL for static contexts */
    int64_t *chosen, *anchors;           /* scratch: (n) each */
    int64_t *read;                       /* a step: anchors that received it */
} ChannelLayer;

/* Nodes of one level, each with its first anchor, its anchors and the bits of their codes known so far. */
typedef struct {
    int64_t *start, *count;
    uint64_t *prefix;
} Nodes;

typedef struct {
    int64_t total, bits;
    uint64_t *codes;       /* (total) */
    uint8_t *open;         /* (total) zeros: bits left to read of anchors that are alone */
    Nodes here, below;     /* scratch, total each */
    int64_t *lower, *rest; /* scratch, total each */
    int64_t *counts;       /* scratch, OWN_TABLES + 3 */
    int32_t *symbols, *order;
    uint16_t *kind;
    int64_t static_read, uniform_read;
} Positions;

/* One level of a hash grid. */
typedef struct {
    int64_t dims, axes[3], resolution, table_log2, features, dense;
    const uint8_t *bits; /* (entries, features) */
} GridLevel;

typedef struct {
    int64_t levels, origin[3], extent_bits, width;
    const GridLevel *level;
} Grid;

/* Which columns the embedding reads, and of what. */
typedef struct {
    int64_t classes, own, attributes, latents, latent_shift, grid, amax;
    const int64_t *anchor_class; /* (n) */
    const int32_t *settled;      /* (n, attributes) */
    const int16_t *features;     /* (n, grid) */
} Embedding;

/* floor(W x + b), clamped; rows of weights are filled up to a multiple of ROWS. */
typedef struct {
    int64_t inputs, outputs;
    const float *weights, *biases;
    float low, high;
} Linear;

/* One recurrent layer. Rows are in the order z, r, n; biases hold the halves of the rounding. */
typedef struct {
    const float *tokens[MOST_HEADS]; /* the first: (codewords, 3H) products of the input */
    const float *inputs;             /* later ones: (3H filled up, H) */
    const float *biases;             /* (tokens, 3H), later ones (1, 3H) */
    const float *recurrent;          /* (3H filled up, H) */
    const float *offsets;            /* (3H) */
} Recurrence;

typedef struct {
    Linear first, second;            /* projections; the second of a two-level head */
    Linear top;                      /* logits of codewords or clusters, not clamped */
    const Members *members;          /* NULL: a flat head */
} Head;

typedef struct {
    int64_t classes, own, attributes, latents, latent_shift, grid; /* columns of the input */
    int64_t amax, hidden, mixed, layers;
    Linear embed[2];
    Linear mix_embedding, mix_state; /* h's share, with the biases, and the state's; neither rounded nor clamped */
    const float *mix_start;          /* (mixed) the state's share before the first token */
    const float *after_first;        /* (codewords, layers, H) states after each coarse codeword */
    const float *sigmoid, *tanh;
    const uint32_t *exp2;
    Recurrence gru[MOST_LAYERS];
    Head heads[MOST_HEADS];
    const float *books[MOST_HEADS];  /* (sizes[b], latents) leading dimensions of codewords */
    int64_t sizes[MOST_HEADS];
} Network;

/* The indices of one tile-layer of `count` anchors. */
typedef struct {
    int64_t count, stages;           /* columns of `indices` */
    const int64_t *classes;          /* (count) */
    const int32_t *settled;          /* (count, attributes) fine values */
    const int16_t *features;         /* (count, grid) */
    int16_t *indices;                /* (count, stages), those read are put in */
    const int64_t *before, *after;   /* (count) stages */
    const int64_t *by_code;          /* (count) anchors by code, then index */
    int64_t passes_log2;
    Cells cells;                     /* of attributes, then latents; sums: scratch */
    int64_t *chosen, *anchors;       /* scratch: (count) each */
    double *means;                   /* scratch: (columns, BLOCK) */
    Lanes *lanes;                    /* scratch of a block */
    Lanes *shares, *states;          /* scratch of a pass: (blocks, mixed), and (blocks, layers, H) beyond two stages */
    uint32_t *weights;               /* scratch: (most logits + 1, BLOCK) */
    int64_t *coded, *clusters;       /* scratch: (count) places in the pass and clusters of the anchors of a stage */
    float *outputs;                  /* scratch: (count, width of the members) */
    int64_t *counts, *order;         /* scratch of scar_rans_members, as what follows */
    float *logits;
    uint32_t *member_weights;
    int32_t *found;
    int64_t modelled;                /* symbols read */
} Indices;

/* A channel of a file, as tiles are read. */
typedef struct {
    int64_t stream, components;
    int64_t attribute, residual;     /* whether it is context for others; whether it moves positions */
    const Rule *rules;               /* (components) */
    const double *widths;            /* (MOST_STEPS + 1, components) of cells after each number of steps */
} TileChannel;

/* What a layer brings, and the tables and predictors in force in it. */
typedef struct {
    int64_t first_class, past_class; /* those that appear */
    int64_t predicted;               /* whether a channel has predictors */
    int64_t stages[CLASS_ROOM];      /* after the layer, by class; 0 where it is still to come */
    int64_t steps[MOST_CHANNELS][CLASS_ROOM];
    int64_t start[MOST_CHANNELS], stop[MOST_CHANNELS]; /* steps that some class may receive; stop: the one after */
    const Tables *const *tables[MOST_CHANNELS];        /* of these steps */
    const Predictor *const *predictors[MOST_CHANNELS]; /* of these steps; NULL: the channel has none in them */
    const Tables *positions, *classes, *indices[MOST_STAGES];
} TileLayer;

/* A file of the explicit profile, up to some layer, without an index network. */
typedef struct {
    int64_t channels, layers, stages; /* stages: columns of indices */
    int64_t attributes;               /* components of all attribute channels */
    int64_t predicted;                /* whether any layer has predictors */
    int64_t passes_log2, depths, targets[MOST_DEPTHS];
    int64_t sizes[MOST_HEADS];        /* codewords in each codebook */
    TileChannel channel[MOST_CHANNELS];
    const TileLayer *layer;
} TileModel;

/* The block of one layer of a tile. */
typedef struct {
    const uint8_t *bytes;             /* NULL: none */
    int64_t length, count;            /* count: anchors that appear */
} TileBlock;

/* One tile: what it is read from and where to. */
typedef struct {
    int64_t total, bits;              /* anchors after all layers; bits of local coordinates */
    const TileBlock *blocks;          /* (layers) */
    uint64_t *codes;                  /* (total) */
    int64_t *classes;                 /* (total) */
    int32_t *values[MOST_CHANNELS];   /* (components, total) */
    int32_t *first[MOST_CHANNELS];    /* (total, components) of the first step; NULL where nobody looks at them */
    int16_t *indices;                 /* (total, stages) */
    int64_t *symbols;                 /* (STREAM_KINDS, 2) read: static, uniform; added to */
    int64_t *received;                /* (layers, channels, MOST_STEPS + 1) anchors that received each step */
} Tile;

/* Where the codes of a tile lie in the world (SPEC 9.1). */
typedef struct {
    double origin[3], voxel, corner[3];
    int64_t shift;
    const double *widths;             /* (MOST_STEPS + 1, 3) of position residuals */
} Frame;

/* One layer of a latent decoder: (outputs, inputs) weights times their scales. */
typedef struct {
    int64_t inputs, outputs;
    const double *weights, *biases;
} Dense;

/* Exact values of anchors, and the Gaussians made of them. */
typedef struct {
    int64_t count, coefficients, latent_width, stages, layers, widest;
    const float *rotation, *opacity;  /* (count, 3), (count); or NULL, */
    const float *colour, *latent;     /* (count, 3), (count, latent_width), too */
    const int16_t *indices;           /* (count, stages) */
    const int64_t *received;          /* (count) stages */
    const float *books[MOST_HEADS];   /* (codewords, latent_width) */
    Dense layer[MOST_LAYERS];
    float *quaternions, *logits, *harmonics; /* (count, 4), (count), (count, coefficients, 3) */
} Activation;

#endif
