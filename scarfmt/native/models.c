/* The models of layers in the order of SPEC 12.2, steps 4 to 7. */

#include "model.h"
#include "network.h"

static void find_most_stages(Model *m, int64_t k) {
    for (int64_t c = 0; c < MOST_CLASSES; c++)
        m->most_stages = m->rows[k].stages[c] > m->most_stages ? m->rows[k].stages[c] : m->most_stages;
}

/* In which layers blocks stand (R-7.8-2, R-7.9-2, R-10.4-2). */
static void plan_blocks(Model *m, int64_t k) {
    const Row *row = m->rows + k;
    int64_t stages = 0;
    for (int64_t c = 0; c < MOST_CLASSES; c++) stages = row->stages[c] > stages ? row->stages[c] : stages;
    for (int64_t b = 0; b < BOOKS; b++)
        if (!m->book_layer[b] && stages > b) m->book_layer[b] = k;
    if (!m->decoder_layer && needs_decoder(m, row)) m->decoder_layer = k;
    if (!m->network_layer && row->mode) m->network_layer = k;
}

static void check_unexpected(const Model *m, int64_t k) {
    const int64_t scene = m->profile == ANCHOR ? 1 : 0;
    const struct {
        int64_t kind, stands;
    } kinds[] = {{CODEBOOKS_BLOCK, m->book_layer[0] == k || m->book_layer[1] == k},
                 {DECODER_MLP, m->decoder_layer == k},
                 {SCENE_MLP, scene == k},
                 {HASH_GRID, m->network_layer == k},
                 {ENTROPY_NETWORK, m->network_layer == k}};
    for (int i = 0; i < 5; i++)
        demand(!m->blocks[k][kinds[i].kind].bytes || kinds[i].stands, "unexpected-block");
}

/* 7a and 7b. */
static void read_decoder(Model *m) {
    const Body block = m->blocks[m->decoder_layer][DECODER_MLP];
    const int64_t latent = channel_of(m, LATENT);
    demand(block.bytes != NULL, "missing-block");
    demand(read_networks(m, block, &m->decoder, 1) == 1, "bad-mlp");
    demand(latent < 0 || m->channel[latent].components == m->decoder.layer[0].columns, "bad-mlp");
}

static void check_book_dims(const Model *m) {
    const int64_t inputs = m->decoder.layers ? m->decoder.layer[0].columns : 0;
    for (int64_t b = 0; b < BOOKS; b++) demand(!m->books[b].size || m->books[b].dims == inputs, "bad-mlp");
}

static int64_t outputs_of(const Mlp *network) { return network->layer[network->layers - 1].rows; }

/* 7e to 7g, as far as these layers have news. */
static void read_scene(Model *m, int64_t from) {
    static const int64_t per_slot[NETWORKS] = {1, 7, 3};
    const Body block = m->blocks[1][SCENE_MLP];
    if (m->profile == EXPLICIT) {
        const int64_t coefficients = (m->sh_degree + 1) * (m->sh_degree + 1);
        const int64_t wanted = 3 * (coefficients - (channel_of(m, COLOUR) >= 0));
        demand(!m->decoder.layers || outputs_of(&m->decoder) == wanted, "bad-mlp");
        return;
    }
    if (from > 1) return;
    demand(block.bytes && read_networks(m, block, m->scene, NETWORKS) == NETWORKS, "bad-mlp");
    demand(m->decoder.layers > 0, "bad-mlp");
    const int64_t inputs = m->scene[0].layer[0].columns, more = inputs - outputs_of(&m->decoder);
    for (int i = 0; i < NETWORKS; i++) {
        const Mlp *network = m->scene + i;
        demand(network->layers == 2 && outputs_of(network) == m->slots * per_slot[i], "bad-mlp");
        demand(network->layer[0].columns == inputs, "bad-mlp");
    }
    demand(more == 3 || more == 4, "bad-mlp");
}

/* 7h to 7l, as far as these layers have news. */
static void read_neural(Model *m, int64_t from) {
    if (!m->network_layer) return;
    const int fresh = m->network_layer >= from;
    if (fresh) {
        const Body block = m->blocks[m->network_layer][ENTROPY_NETWORK];
        const Body grid = m->blocks[m->network_layer][HASH_GRID];
        demand(block.bytes != NULL, "missing-block");
        read_network(m, block);
        check_network(m);
        if (grid.bytes) read_grid(m, grid);
    }
    check_network_fits(m);
    if (fresh) pack_network(m);
    for (int64_t b = 0; b < BOOKS; b++)
        if (m->books[b].size && (fresh || m->book_layer[b] >= from)) pack_head(m, b);
}

static void forget_blocks(Model *m, int64_t from, int64_t to) {
    for (int64_t k = from; k <= to; k++)
        for (int kind = 0; kind < BLOCK_KINDS; kind++) {
            memory_give((void *)m->blocks[k][kind].bytes);
            m->blocks[k][kind] = (Body){0};
        }
}

/* Reads the models of layers from..to, whose blocks were given; those of all layers before were read. */
void read_models(Model *m, int64_t from, int64_t to) {
    demand(from == m->layers + 1 && to >= from && to <= MOST_FILE_LAYERS, "missing-block");
    for (int64_t k = from; k <= to; k++) {
        read_layer_block(m, k);
        read_tables(m, k);
    }
    if (from == 1) check_channels(m);
    check_layer_rows(m, from, to);
    for (int64_t k = from; k <= to; k++) plan_blocks(m, k), find_most_stages(m, k);
    for (int64_t k = from; k <= to; k++) check_unexpected(m, k);
    if (m->decoder_layer >= from) read_decoder(m);
    for (int64_t k = from; k <= to; k++) read_codebooks(m, k);
    if (from == 1) finish_channels(m);
    check_book_dims(m);
    read_scene(m, from);
    read_neural(m, from);
    for (int64_t k = from; k <= to; k++) read_predictors(m, k);
    for (int64_t k = from; k <= to; k++) pack_layer(m, k);
    forget_blocks(m, from, to);
    m->layers = to;
}

void forget_model(Model *m) {
    forget_blocks(m, 1, MOST_FILE_LAYERS);
    pool_empty(&m->pool, 0);
    memory_give(m);
}
