/* PREDICTORS blocks (SPEC 10.3), read, checked and packed as the kernel multiplies them. */

#include "linear.h"
#include "tile.h"
#include "products.h"

#define MOST_PREDICTORS 1024
#define MOST_PREDICTOR_UNITS 64
#define CLASS_COLUMNS 15
#define CLASS_INPUT 64
#define HEAD_FIELDS 8
#define BAD "bad-predictor"

/* What a record says before its layers. */
typedef struct {
    int64_t stream, component, step, b1, b2, classes, inputs, units;
} PredictorHead;

/* A block and the models of its fields: `fields` of those of a head, in order. */
typedef struct {
    LinearReader layers;
    NumberModel fields[HEAD_FIELDS];
} PredictorReader;

static PredictorHead read_head(PredictorReader *reader) {
    int64_t f[HEAD_FIELDS];
    for (int i = 0; i < HEAD_FIELDS; i++) f[i] = read_limited(&reader->layers.numbers, reader->fields + i, MOST_U8);
    const PredictorHead h = {f[0], f[1], f[2], f[3] + 1, f[4] + 1, f[5], f[6], f[7]};
    demand(is_attribute(h.stream) || h.stream == LATENT, BAD);
    demand(h.classes <= CLASS_COLUMNS && h.inputs > CLASS_COLUMNS && h.units <= MOST_PREDICTOR_UNITS, BAD);
    return h;
}

/* A layer with all its columns: those of classes without weights are zeros. */
static Linear read_layer(PredictorReader *reader, Pool *pool, int64_t rows, int64_t columns, int64_t classes) {
    Linear layer = read_linear(&reader->layers, pool, rows, columns + classes - CLASS_COLUMNS, BAD);
    const int32_t *from = layer.weights;
    int32_t *weights = pool_zeros(pool, 4 * rows * columns);
    for (int64_t r = 0; r < rows; r++)
        for (int64_t c = 0; c < layer.columns; c++)
            weights[r * columns + (c < classes ? c : c + CLASS_COLUMNS - classes)] = *from++;
    layer.columns = columns, layer.weights = weights;
    return layer;
}

/* What the sums of a row start with, by class. */
static void put_starts(const int32_t *weights, int64_t bias, int32_t *starts) {
    for (int64_t c = 0; c < CLASS_STARTS; c++)
        starts[c] = (int32_t)(bias + (c < CLASS_COLUMNS ? CLASS_INPUT * (int64_t)weights[c] : 0));
}

/* Words of the weights of a row, in the order of the words of inputs (steps.h). */
static void put_row(const int32_t *row, int64_t inputs, int64_t own, int64_t depths, int32_t *out) {
    const int64_t relative = inputs - depths, counts = relative - depths, means = counts - depths * own;
    const struct {
        int64_t first, columns;
    } parts[2] = {{CLASS_COLUMNS, means - own - CLASS_COLUMNS}, {means - own, own}};
    for (int p = 0; p < 2; p++)
        for (int64_t c = 0; c < parts[p].columns; c += 2) {
            const int32_t *at = row + parts[p].first + c;
            *out++ = pair_of(at[0], c + 1 < parts[p].columns ? at[1] : 0);
        }
    for (int64_t d = 0; d < depths; d++)
        for (int64_t c = 0; c <= own; c += 2) {
            const int32_t *at = row + means + d * own + c;
            *out++ = pair_of(c < own ? at[0] : row[counts + d],
                             c + 1 < own ? at[1] : c + 1 == own ? row[counts + d] : 0);
        }
    for (int64_t d = 0; d < depths; d += 2)
        *out++ = pair_of(row[relative + d], d + 1 < depths ? row[relative + d + 1] : 0);
}

/* own: components of the channel. */
static Predictor packed(Model *m, const PredictorHead *h, int64_t own, const Linear *hidden, const Linear *output) {
    const int64_t rows = 2 + h->units + h->units % 2, depths = m->depths, before = h->inputs - CLASS_COLUMNS - own -
                                                                                   depths * (own + 2);
    Predictor p = {.rows = rows, .output_shift = (int32_t)output->shift};
    p.shared = (before + 1) / 2 + (own + 1) / 2 + depths * ((own + 2) / 2), p.own = (depths + 1) / 2;
    int32_t *starts = pool_zeros(&m->pool, 4 * rows * CLASS_STARTS);
    int32_t *weights = pool_zeros(&m->pool, 4 * rows * (p.shared + p.own));
    for (int64_t r = 0; r < 2 + h->units; r++) {
        const Linear *layer = r < 2 ? output : hidden;
        const int64_t row = r < 2 ? r : r - 2;
        const int32_t *from = layer->weights + row * layer->columns;
        put_starts(from, layer->biases[row] + half_of_shift(layer->shift), starts + r * CLASS_STARTS);
        put_row(from, h->inputs, own, depths, weights + r * (p.shared + p.own));
    }
    p.starts = starts, p.weights = weights;
    p.output = paired_words(&m->pool, output->weights, 2, output->columns, h->inputs, h->units, 0);
    if (h->units) p.shift = (int32_t)hidden->shift;
    p.last[0] = (int32_t)h->b1 - 1, p.last[1] = (int32_t)h->b2 - 1;
    return p;
}

/* R-10.3-3; returns the number of the channel. */
static int64_t check_head(const Model *m, int64_t k, const PredictorHead *h, int64_t *before) {
    const int64_t key = h->stream << 16 | h->component << 8 | h->step, i = channel_of(m, h->stream);
    demand(key > *before, BAD);
    *before = key;
    demand(i >= 0 && h->component < m->channel[i].components, BAD);
    int64_t first = 0, seen = m->channel[i].components;
    for (int64_t layer = k; layer >= 1; layer--)
        for (int64_t c = 0; c < MOST_CLASSES; c++)
            if (m->rows[layer].steps[i][c] >= h->step) first = layer;
    demand(first == k, BAD);
    for (int64_t c = 0; c < i; c++)
        if (is_attribute(m->channel[c].stream)) seen += m->channel[c].components;
    demand(h->inputs == CLASS_COLUMNS + seen + m->depths * (m->channel[i].components + 2), BAD);
    return i;
}

/* The predictors of layer k and those of the layer before it. */
void predictors_in_force(Model *m, int64_t k, const PredictorModel *added, int64_t count) {
    const PredictorsInForce *before = m->predictors + k - 1;
    PredictorsInForce *out = m->predictors + k;
    out->predictors = pool_take(&m->pool, (int64_t)sizeof *out->predictors * (before->count + count));
    out->count = 0;
    for (int64_t i = 0; i < before->count; i++) out->predictors[out->count++] = before->predictors[i];
    for (int64_t i = 0; i < count; i++) out->predictors[out->count++] = added + i;
}

/* The PREDICTORS block of layer k, if it has one. */
void read_predictors(Model *m, int64_t k) {
    const Body block = m->blocks[k][PREDICTORS];
    if (!block.bytes) {
        predictors_in_force(m, k, NULL, 0);
        return;
    }
    PredictorReader reader = {.layers.numbers = open_numbers(m, block)};
    const int64_t count = read_once(&reader.layers.numbers, MOST_PREDICTORS);
    demand(count >= 1, BAD);
    PredictorHead *heads = pool_take(&layer_scratch, (int64_t)sizeof *heads * count);
    Linear *layers = pool_zeros(&layer_scratch, 2 * (int64_t)sizeof *layers * count);
    for (int64_t i = 0; i < count; i++) {
        PredictorHead *h = heads + i;
        Linear *hidden = layers + 2 * i, *output = hidden + 1;
        *h = read_head(&reader);
        if (h->units) *hidden = read_layer(&reader, &layer_scratch, h->units, h->inputs, h->classes);
        *output = read_layer(&reader, &layer_scratch, 2, h->inputs + h->units, h->classes);
        demand((!h->units || linear_fits(hidden, AMAX)) && linear_fits(output, AMAX), BAD);
        demand(h->step >= 1 && h->b1 * h->b2 <= 256, BAD);
    }
    seal_numbers(&reader.layers.numbers);
    PredictorModel *made = pool_take(&m->pool, (int64_t)sizeof *made * count);
    int64_t before = -1;
    for (int64_t i = 0; i < count; i++) {
        const int64_t channel = check_head(m, k, heads + i, &before);
        made[i] = (PredictorModel){heads[i].stream, heads[i].component, heads[i].step, {0}};
        made[i].packed = packed(m, heads + i, m->channel[channel].components, layers + 2 * i, layers + 2 * i + 1);
    }
    predictors_in_force(m, k, made, count);
}
