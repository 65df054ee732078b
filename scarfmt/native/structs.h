/* What the inner loops work on. */

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

/* A decoder's state and its words, of which the last is taken first (SPEC 8.2). */
typedef struct {
    uint64_t state;
    uint64_t left;
    const uint32_t *words;
} Rans;

/* A table of up to three symbols, unpacked: where the second and the third begin, TOTAL for none; what first and frequency
change by from the first to the second symbol and from that to the third. All zeros: no such table. */
typedef struct {
    uint32_t second, third;
    int32_t next_first, wider, last_wider;
    int32_t values[3];
} FewSymbols;

/* A static table: `size` values, and one cumulative frequency more. Of up to three symbols `few`; of others `near`, the
symbol at the start of each of the parts of 2^near_shift slots. */
typedef struct {
    uint32_t key;
    int32_t size;
    const int32_t *values;
    const uint32_t *sums;
    FewSymbols few;
    const uint16_t *near;
    int32_t near_shift;
} StaticTable;

/* Static tables by kind, NULL for none. */
typedef struct {
    int64_t kinds;
    const StaticTable *const *table;
} Tables;

/* Sums over the anchors of each cell, up to MOST_DEPTHS depths, coarse first. */
typedef struct {
    int64_t depths, columns;
    const int32_t *cell[MOST_DEPTHS]; /* per anchor (n), its cell at each depth */
    double *sums[MOST_DEPTHS];        /* (cells, columns + 1): sums, and in the last column the count */
    int64_t sizes[MOST_DEPTHS];       /* cells */
    int32_t *means[MOST_DEPTHS];      /* scratch: (cells, columns + 1 filled up to a multiple of 4) */
} Cells;

/* clamp((W x + b) >> shift) over words, in each of which lie two inputs, or two weights: the first in the lower half. */
typedef struct {
    int64_t rows, words;            /* rows are filled up to be even */
    const int32_t *weights, *biases; /* (rows, words), (rows) with the half of the rounding */
    int32_t shift, low, high, unused;
} Layer;

/* One component's part of a step. Rows: the two of the output that look at inputs, then hidden units, filled up to be
even. Classes are no inputs, but where the sums start. */
typedef struct {
    int64_t rows, shared, own; /* words of inputs: shared by the components, and of this one alone */
    const int32_t *starts;     /* (rows, CLASS_STARTS), biases and halves of the roundings with them */
    const int32_t *weights;    /* (rows, shared + own) */
    const int32_t *output;     /* (2, hidden units / 2) */
    int32_t shift, output_shift;
    int32_t last[2];           /* buckets - 1 */
} Predictor;

/* One channel in one tile-layer of n anchors. */
typedef struct {
    int64_t count, components;
    const uint8_t *classes;          /* (n) */
    int32_t *values;                 /* (n, components) before and after */
    int64_t *steps;                  /* (n) steps that values are at */
    const int32_t *settled;          /* (n, settled_stride) fine values, the first settled_columns are inputs */
    int64_t settled_columns, settled_stride;
    Cells cells;                     /* sums: scratch */
    int32_t *rows;                   /* scratch: (n, row_words of channel.c) */
    int64_t rows_step;               /* the step after which `rows` hold fine values, 0 for none: none on entry */
    int32_t *inputs;                 /* scratch: (BLOCKs of the widest pass, width, BLOCK); one block beyond step 1 */
    uint16_t *kind;                  /* scratch: (components, widest pass) */
    int32_t *symbols, *order;        /* scratch: as many each */
    int64_t *counts;                 /* scratch: kinds + 1 of the tables of most kinds */
    /* Of one step: */
    int64_t step;
    const Predictor *predictors;     /* (components), those of 0 rows are none; NULL: none at all */
    const Tables *tables;
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
    const uint8_t *anchor_class; /* (n) */
    const int32_t *settled;      /* (n, attributes) */
    const int16_t *features;     /* (n, grid) */
} Embedding;

/* One recurrent layer. Rows are in the order z, r, n; biases of the input hold the half of the rounding. */
typedef struct {
    const int32_t *tokens[MOST_HEADS]; /* the first: (codewords, 3H) products of the input */
    Layer inputs;                      /* later ones */
    const int32_t *biases;             /* the first: (tokens, 3H) */
    Layer recurrent;                   /* products with the state, not rounded */
    int64_t shift;
} Recurrence;

typedef struct {
    Layer project, top; /* top: logits of codewords, not clamped */
    int64_t size;       /* codewords */
} Head;

typedef struct {
    int64_t classes, own, attributes, latents, latent_shift, grid; /* columns of the input */
    int64_t amax, hidden, layers;
    Layer embed[2];
    Layer mix_embedding, mix_state; /* h's share, with the biases, and the state's; neither rounded nor clamped */
    int64_t mix_shift;
    const int32_t *mix_start;       /* (rows of mix_state) the state's share before the first token */
    const int32_t *after_first;     /* (codewords, layers, H) states after each coarse codeword */
    const int32_t *sigmoid, *tanh;
    const uint32_t *exp2;
    Recurrence gru[MOST_LAYERS];
    Head heads[MOST_HEADS];
    const float *books[MOST_HEADS]; /* (sizes[b], latents) leading dimensions of codewords */
    int64_t sizes[MOST_HEADS];
} Network;

/* The indices of one tile-layer of `count` anchors. */
typedef struct {
    int64_t count, stages;           /* columns of `indices` */
    const uint8_t *classes;          /* (count) */
    const int32_t *settled;          /* (count, attributes) fine values */
    const int16_t *features;         /* (count, grid) */
    int16_t *indices;                /* (count, stages), those read are put in */
    const int64_t *before, *after;   /* (count) stages */
    const int64_t *by_code;          /* (count) anchors by code, then index */
    int64_t passes_log2;
    Cells cells;                     /* of attributes, then latents; sums: scratch */
    int64_t *chosen, *anchors;       /* scratch: (count) each */
    int32_t *means, *inputs;         /* scratch: (columns + 4, BLOCK), and of all inputs (columns + 1, BLOCK) */
    int32_t *lanes;                  /* scratch of a block, network_lanes of packed_network.py times BLOCK */
    int32_t *shares, *states;        /* scratch of a pass: (blocks, mixed), and (blocks, layers, H) beyond two stages */
    uint32_t *weights;               /* scratch: (most logits + 1, BLOCK) */
} Indices;

#endif
