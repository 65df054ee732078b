/* The index network of a file (SPEC 10.5), as its block holds it and packed as the kernel reads it. */

#ifndef SCAR_NETWORK_H
#define SCAR_NETWORK_H

#include "linear.h"
#include "model.h"

#define MOST_HIDDEN 256
#define GATES 3
#define TABLE_END 255
#define EXP2_WEIGHTS 513
#define HISTORY (MOST_TOKENS + 1)

/* wi: (3H, inputs), one a head in the first layer, else one; bi: (tokens, 3H) in the first, else (3H). */
typedef struct {
    int64_t shift, inputs;
    const int32_t *wi[BOOKS], *wh, *bi, *bh, *start;
} RecurrentModel;

typedef struct {
    int64_t size, shift;
    Linear project;
    const int32_t *biases;
    const int32_t *e; /* (size, R + 1) codewords as activations; NULL: its codebook was not received */
} HeadModel;

struct NetworkModel {
    int64_t activation_bits, own, attention, latent_shift, codeword_shift;
    int64_t classes, attributes, depths, latents, grid, dims, embed_width, hidden, mixed, layers, tokens, heads;
    int64_t inputs, amax, score_shift;
    Linear embed1, embed2, query, key, value, mixer;
    RecurrentModel gru[MOST_LAYERS];
    HeadModel head[MOST_HEADS];
    Network packed;
};

void read_network(Model *m, Body block);
void check_network(const Model *m);
void check_network_fits(const Model *m);
void pack_network(Model *m);
void pack_head(Model *m, int64_t b); /* of a codebook that was received */

/* The new state g of a recurrent layer after px, the products of its input with biases (SPEC 10.5, gru). */
void gru_step(const NetworkModel *net, const RecurrentModel *layer, const int32_t *px, int32_t *g);

/* The states (layers, H) after token t, which is codeword `index`, in place. */
void advance_states(const NetworkModel *net, int64_t t, int64_t index, int32_t *states);

/* W x + b of (rows, columns) weights; b: NULL for none. */
void multiply(const int32_t *weights, int64_t rows, int64_t columns, const int32_t *x, const int32_t *b, int32_t *out);

/* What the reading of a tile's indices lends to it. */
void lend_network(const NetworkModel *net, Pool *scratch, Indices *s, int64_t stages);

/* Indices of a network with attention: as scar_indices. */
void attentive_indices(Rans *rans, const NetworkModel *net, Indices *s, Pool *scratch);

#endif
