/* A file as far as its header and the models of its layers are known (SPEC 5.2, 6, 7.8-7.12, 10). */

#ifndef SCAR_MODEL_H
#define SCAR_MODEL_H

#include "kernel.h"
#include "memory.h"
#include "payload.h"

#define MOST_FILE_LAYERS 16
#define MOST_CLASSES 15
#define MOST_COMPONENTS 64
#define MOST_MLP_LAYERS 4
#define MOST_TOKENS 7
#define NETWORKS 3 /* of a scene: opacity, covariance, colour */
#define BOOKS 2
#define BLOCK_KINDS 9
#define FREE_NUMBERS (1ll << 20)
#define NUMBERS_PER_BYTE 2

enum { EXPLICIT, ANCHOR };
enum { LAYER_BLOCK = 1, TABLES_BLOCK, CODEBOOKS_BLOCK, DECODER_MLP, SCENE_MLP, HASH_GRID, ENTROPY_NETWORK, PREDICTORS };
enum { POSITIONS = 1, CLASSES, MASKS, POSITION_RESIDUAL, SCALE, ROTATION, OPACITY, COLOUR, INDICES, LATENT, OFFSETS };

typedef struct {
    const uint8_t *bytes; /* NULL: none */
    int64_t length;
} Body;

typedef struct {
    int64_t stream, components;
    double first_width[MOST_COMPONENTS];
    double *widths; /* (MOST_STEPS + 1, components) */
} ChannelModel;

/* What classes have after a layer; zeros where a class is still to come. */
typedef struct {
    int64_t mode, classes;
    int64_t stages[CLASS_ROOM], steps[MOST_CHANNELS][CLASS_ROOM];
} Row;

/* The tables in force in a layer, by ascending key. */
typedef struct {
    int64_t count;
    const StaticTable **tables;
} TablesInForce;

/* weights: (columns, stride) times the scales of their rows, column after column; biases: (stride). Rows are filled up
with zeros to be a multiple of FILLED. */
#define FILLED 8

typedef struct {
    int64_t rows, columns, stride;
    const float *weights, *biases;
} MlpLayer;

typedef struct {
    int64_t layers; /* 0: no such network */
    MlpLayer layer[MOST_MLP_LAYERS];
} Mlp;

typedef struct {
    int64_t size, dims; /* 0: not received */
    const int32_t *words; /* (size, dims) */
} Book;

/* A predictor and where it belongs. */
typedef struct {
    int64_t stream, component, step;
    Predictor packed;
} PredictorModel;

typedef struct {
    int64_t count;
    const PredictorModel **predictors;
} PredictorsInForce;

/* What a layer is read with, beyond its row. */
typedef struct {
    int64_t predicted;                                 /* whether a channel has predictors */
    int64_t start[MOST_CHANNELS], stop[MOST_CHANNELS]; /* steps that some class may receive; stop: the one after */
    const Tables **tables[MOST_CHANNELS];              /* of these steps; of OFFSETS one */
    const Predictor **predictors[MOST_CHANNELS];       /* of these steps, NULL where static; NULL: none has any */
    const Tables *positions, *classes, *masks, *indices[MOST_STAGES];
} LayerModel;

typedef struct NetworkModel NetworkModel;

typedef struct {
    int64_t profile, sh_degree, slots, lattice_bits;
    double origin[3], voxel;
    Body blocks[MOST_FILE_LAYERS + 1][BLOCK_KINDS];
    int64_t layers;      /* whose models are read */
    int64_t channels;
    ChannelModel channel[MOST_CHANNELS];
    int64_t passes_log2, depths, targets[MOST_DEPTHS];
    int64_t attributes;  /* components of all attribute channels */
    int64_t most_stages; /* that a class has in the layers read */
    int64_t numbers_left; /* adaptive numbers that further blocks may have (SPEC 13.2) */
    Row rows[MOST_FILE_LAYERS + 1]; /* the first: before layer 1 */
    TablesInForce tables[MOST_FILE_LAYERS + 1];
    PredictorsInForce predictors[MOST_FILE_LAYERS + 1];
    LayerModel layer[MOST_FILE_LAYERS + 1];
    int64_t decoder_layer, network_layer, book_layer[BOOKS]; /* in which they stand, 0 for none yet */
    Mlp decoder, scene[NETWORKS];
    Book books[BOOKS];
    Grid grid; /* levels 0: none */
    NetworkModel *network;
    Pool pool;
} Model;

/* Reads the models of layers from..to, whose blocks were given; those of all layers before were read. */
void read_models(Model *m, int64_t from, int64_t to);
void forget_model(Model *m);

/* Of so many tiles that have anchors after each layer, and so many anchors and splits; -1 where there are networks. */
double declared_work(const Model *m, const int64_t *tiles, int64_t anchors, int64_t splits);

int64_t is_attribute(int64_t stream);
int64_t channel_of(const Model *m, int64_t stream); /* its number, -1 for none */

/* The parts of reading models, in the order of SPEC 12.2; each refuses what it finds broken. */
void read_layer_block(Model *m, int64_t k);
void check_channels(Model *m);
void check_layer_rows(const Model *m, int64_t from, int64_t to);
void finish_channels(Model *m);
int64_t needs_decoder(const Model *m, const Row *row);

void read_tables(Model *m, int64_t k);
const Tables *pack_tables(Model *m, int64_t k, int64_t stream, int64_t first, int64_t components, int64_t step);
void pack_layer(Model *m, int64_t k);

int64_t read_networks(Model *m, Body block, Mlp *out, int64_t most);
void read_codebooks(Model *m, int64_t k);
void read_grid(Model *m, Body block);
int64_t grid_bits(const GridLevel *level); /* of the table of a level */

void read_predictors(Model *m, int64_t k);
void predictors_in_force(Model *m, int64_t k, const PredictorModel *added, int64_t count);

#endif
