/* The work that a file without networks declares (SPEC 13.2): what scarfmt/coding/work.py defines, where its terms are named. */

#include "tile.h"

#define SYMBOL 256.
#define GROUP 32768.
#define RECORD 131072.
#define TILE_LAYER 2097152.
#define SPLIT 65536.
#define PRODUCT 2.
#define NUMBER 16.
#define OUTPUT 2048.

/* Whether a class receives a step of a stream in layer k. */
static int receives(const Model *m, int64_t k, int64_t stream, int64_t step) {
    const int64_t channel = channel_of(m, stream);
    if (channel < 0) return 0;
    const int64_t *before = m->rows[k - 1].steps[channel], *after = m->rows[k].steps[channel];
    for (int64_t c = 0; c < m->rows[k].classes; c++)
        if (before[c] < step && step <= after[c]) return 1;
    return 0;
}

static double of_tile(const Model *m, int64_t k) {
    const TablesInForce *all = m->tables + k;
    int64_t usable = 0;
    for (int64_t i = 0; i < all->count; i++) {
        const int64_t stream = all->tables[i]->key >> 24, step = all->tables[i]->key >> 8 & 255;
        usable += !step || stream == OFFSETS || receives(m, k, stream, step);
    }
    return TILE_LAYER + GROUP * (double)usable;
}

static double of_anchor(const Model *m, int64_t k, int64_t class) {
    const Row *before = m->rows + k - 1, *row = m->rows + k;
    if (class >= row->classes) return 0;
    int64_t symbols = 1 + m->channels + row->stages[class] - before->stages[class];
    for (int64_t c = 0; c < m->channels; c++)
        symbols += m->channel[c].components * (row->steps[c][class] - before->steps[c][class]);
    if (m->profile == ANCHOR) symbols += m->slots * (class < before->classes ? 1 : 4);
    return SYMBOL * (double)symbols;
}

static double of_network(const Mlp *network) {
    int64_t products = 0, widest = 0;
    for (int64_t l = 0; l < network->layers; l++) {
        products += network->layer[l].rows * network->layer[l].columns;
        widest = network->layer[l].rows > widest ? network->layer[l].rows : widest;
    }
    return network->layers ? PRODUCT * (double)products + NUMBER * (double)(widest + network->layer[0].columns) : 0;
}

static double of_result(const Model *m) {
    double work = of_network(&m->decoder);
    int64_t numbers = 0;
    for (int64_t c = 0; c < m->channels; c++) numbers += m->channel[c].components;
    for (int i = 0; i < NETWORKS; i++) work += of_network(m->scene + i);
    const Mlp *first = m->decoder.layers ? &m->decoder : m->scene;
    return work + NUMBER * (double)numbers + (first->layers ? OUTPUT * (double)first->layer[first->layers - 1].rows : 0);
}

double declared_work(const Model *m, const int64_t *tiles, int64_t anchors, int64_t splits) {
    double work = RECORD * (double)m->tables[m->layers].count + SPLIT * (double)splits, most = 0;
    if (m->network || m->grid.levels) return -1;
    for (int64_t k = 1; k <= m->layers; k++) {
        if (m->predictors[k].count) return -1;
        work += (double)tiles[k - 1] * of_tile(m, k);
    }
    for (int64_t class = 0; class < m->rows[m->layers].classes; class++) {
        double here = 0;
        for (int64_t k = 1; k <= m->layers; k++) here += of_anchor(m, k, class);
        most = here > most ? here : most;
    }
    return work + (double)anchors * (most + of_result(m));
}
