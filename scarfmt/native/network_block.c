/* ENTROPY_NETWORK blocks (SPEC 10.5), read and checked. */

#include "network.h"

#define MOST_COUNT 512
#define MOST_DIMS 64
#define MOST_WIDTH 256
#define MOST_CODEWORDS 4096
#define RECURRENT_LIMIT (1ll << 23)
#define BAD "bad-network"

/* A block and the models of its fields. */
typedef struct {
    LinearReader layers;
    NumberModel size;
    ShiftedModel bi, bh, start;
} NetworkReader;

static void read_recurrent(NetworkReader *reader, Model *m, int64_t inputs, int64_t matrices, int64_t bias_rows,
                           RecurrentModel *out) {
    const int64_t hidden = m->network->hidden, rows = GATES * hidden;
    LinearReader *layers = &reader->layers;
    Numbers *numbers = &layers->numbers;
    out->shift = read_limited(numbers, &layers->shift, MOST_U8), out->inputs = inputs;
    for (int64_t i = 0; i < matrices; i++) out->wi[i] = read_weights(layers, &m->pool, rows * inputs, BAD);
    out->wh = read_weights(layers, &m->pool, rows * hidden, BAD);
    out->bi = read_shifted(numbers, &reader->bi, &m->pool, bias_rows * rows);
    out->bh = read_shifted(numbers, &reader->bh, &m->pool, rows);
    out->start = read_shifted(numbers, &reader->start, &m->pool, hidden);
}

static void read_head(NetworkReader *reader, Model *m, HeadModel *out) {
    const int64_t rows = m->network->dims + 1, mixed = m->network->mixed;
    LinearReader *layers = &reader->layers;
    Numbers *numbers = &layers->numbers;
    out->size = read_limited(numbers, &reader->size, MOST_CODEWORDS);
    out->project = read_linear(layers, &m->pool, rows, mixed, BAD);
    out->shift = read_limited(numbers, &layers->shift, MOST_U8);
    out->biases = read_shifted(numbers, &layers->biases, &m->pool, out->size);
}

/* The numbers before the layers, with R-10.5-1. */
static void read_shape(Numbers *numbers, NetworkModel *net) {
    net->activation_bits = read_once(numbers, MOST_U8);
    const int64_t flags = read_once(numbers, MOST_U8);
    net->own = flags & 1, net->attention = flags >> 1 & 1;
    net->latent_shift = read_once(numbers, MOST_U8), net->codeword_shift = read_once(numbers, MOST_U8);
    net->classes = read_once(numbers, MOST_COUNT), net->attributes = read_once(numbers, MOST_COUNT);
    net->depths = read_once(numbers, MOST_COUNT), net->latents = read_once(numbers, MOST_COUNT);
    net->grid = read_once(numbers, MOST_COUNT);
    net->dims = read_once(numbers, MOST_DIMS);
    net->embed_width = read_once(numbers, MOST_WIDTH), net->hidden = read_once(numbers, MOST_WIDTH);
    net->mixed = read_once(numbers, MOST_WIDTH);
    net->layers = read_once(numbers, MOST_LAYERS), net->tokens = read_once(numbers, MOST_TOKENS);
    net->heads = read_once(numbers, MOST_HEADS);
    net->inputs = net->classes + (net->own ? net->attributes : 0) +
                  net->depths * (net->attributes + net->latents + 1) + net->grid;
    demand(flags <= 3 && net->inputs <= MOST_COUNT, BAD);
}

void read_network(Model *m, Body block) {
    NetworkReader reader = {.layers.numbers = open_numbers(m, block)};
    LinearReader *layers = &reader.layers;
    NetworkModel *net = m->network = pool_zeros(&m->pool, sizeof *net);
    read_shape(&layers->numbers, net);
    const int64_t hidden = net->hidden;
    net->embed1 = read_linear(layers, &m->pool, net->embed_width, net->inputs, BAD);
    net->embed2 = read_linear(layers, &m->pool, hidden, net->embed_width, BAD);
    for (int64_t j = 0; j < net->layers; j++)
        if (j)
            read_recurrent(&reader, m, hidden, 1, 1, net->gru + j);
        else
            read_recurrent(&reader, m, net->dims + 1, net->heads, net->tokens, net->gru);
    if (net->attention) {
        net->query = read_linear(layers, &m->pool, hidden, hidden, BAD);
        net->key = read_linear(layers, &m->pool, hidden, hidden, BAD);
        net->value = read_linear(layers, &m->pool, hidden, hidden, BAD);
        net->score_shift = read_once(&layers->numbers, MOST_U8);
    }
    net->mixer = read_linear(layers, &m->pool, net->mixed, 2 * hidden, BAD);
    for (int64_t b = 0; b < net->heads; b++) read_head(&reader, m, net->head + b);
    seal_numbers(&layers->numbers);
}

/* R-10.5-3 of a recurrent layer, and its start. */
static void check_recurrent(const NetworkModel *net, int64_t j) {
    const RecurrentModel *layer = net->gru + j;
    const int64_t rows = GATES * net->hidden, matrices = j ? 1 : net->heads, bias_rows = j ? 1 : net->tokens;
    for (int64_t u = 0; u < net->hidden; u++)
        demand(layer->start[u] >= -net->amax && layer->start[u] <= net->amax, BAD);
    for (int64_t r = 0; r < rows; r++) {
        int64_t largest = 0;
        for (int64_t t = 0; t < bias_rows; t++) {
            const int64_t bias = layer->bi[t * rows + r], size = bias < 0 ? -bias : bias;
            largest = size > largest ? size : largest;
        }
        for (int64_t i = 0; i < matrices; i++)
            demand(row_fits(layer->wi[i] + r * layer->inputs, layer->inputs, largest, layer->shift, net->amax,
                            RECURRENT_LIMIT), BAD);
        demand(row_fits(layer->wh + r * net->hidden, net->hidden, layer->bh[r], layer->shift, net->amax,
                        RECURRENT_LIMIT), BAD);
    }
}

/* R-10.5-2 to R-10.5-5. */
void check_network(const Model *m) {
    NetworkModel *net = m->network;
    demand(net->activation_bits >= 8 && net->activation_bits <= 12, BAD);
    demand(net->inputs >= 1 && net->dims >= 1 && net->embed_width >= 1 && net->hidden >= 1 && net->mixed >= 1, BAD);
    demand(net->layers >= 1 && net->heads >= 1 && net->classes <= MOST_CLASSES, BAD);
    demand(net->latent_shift <= MOST_SHIFT && net->codeword_shift <= MOST_SHIFT && net->score_shift <= MOST_SHIFT, BAD);
    for (int64_t j = 0; j < net->layers; j++) demand(net->gru[j].shift <= MOST_SHIFT, BAD);
    net->amax = largest_activation(net->activation_bits);
    demand(linear_fits(&net->embed1, net->amax) && linear_fits(&net->embed2, net->amax), BAD);
    demand(linear_fits(&net->mixer, net->amax), BAD);
    if (net->attention) {
        demand(linear_fits(&net->query, net->amax) && linear_fits(&net->key, net->amax), BAD);
        demand(linear_fits(&net->value, net->amax), BAD);
    }
    for (int64_t j = 0; j < net->layers; j++) check_recurrent(net, j);
    demand(!net->tokens || net->heads == 2, BAD);
    for (int64_t b = 0; b < net->heads; b++)
        demand(net->head[b].size >= 1 && net->head[b].shift <= MOST_SHIFT && linear_fits(&net->head[b].project, net->amax),
               BAD);
}

/* R-10.5-6 but for the codebooks. */
void check_network_fits(const Model *m) {
    const NetworkModel *net = m->network;
    const int64_t dims = m->decoder.layers ? m->decoder.layer[0].columns : 0;
    demand(net->attributes == m->attributes && net->depths == m->depths, BAD);
    demand(net->grid == m->grid.width && net->dims <= dims && net->latents <= dims, BAD);
    demand(net->tokens + 1 >= m->most_stages, BAD);
}
