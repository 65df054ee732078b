/* TABLES blocks (SPEC 8.1, 8.3), and the tables of a step side by side as the kernel reads them. */

#include "numbers.h"
#include "rans.h"
#include "steps.h"
#include "tile.h"

#define MOST_TABLES 65536
#define MOST_ALPHABET 4096
#define MOST_DIGIT 255
#define WEIGHT_BITS 24
#define STEPS_APART 3 /* steps with models of their own; the last serves all later ones too */
#define LARGEST 2147483647
#define FEW 3
#define MOST_NEAR_BITS 10
#define PARTS_A_SYMBOL 8

/* A TABLES block and the models of its fields. */
typedef struct {
    Numbers numbers;
    NumberModel digits[4][2], more[STEPS_APART], first[STEPS_APART], gaps[STEPS_APART], precision[STEPS_APART];
    NumberModel weights[WEIGHT_BITS];
} TableReader;

/* Cumulative frequencies of weights (SPEC 8.1). */
static void put_sums(const uint32_t *weights, int64_t n, uint32_t *sums) {
    uint64_t total = 0, sum = 0;
    for (int64_t i = 0; i < n; i++) total += weights[i];
    for (int64_t i = 0; i < n; sum += weights[i++])
        sums[i] = (uint32_t)(sum * (uint64_t)(TOTAL - n) / total + (uint64_t)i);
    sums[n] = TOTAL;
}

static FewSymbols few_of(const StaticTable *table) {
    const int64_t n = table->size;
    const uint32_t second = n > 1 ? table->sums[1] : TOTAL, third = n > 2 ? table->sums[2] : TOTAL;
    const int32_t apart = (int32_t)(third - second);
    return (FewSymbols){second, third, apart, apart - (int32_t)second, (int32_t)(TOTAL - third) - apart,
                        {table->values[0], table->values[n > 1 ? 1 : 0], table->values[n - 1]}};
}

/* Parts are some to a symbol: a stranger's table of few symbols takes little memory. */
static void find_near(Pool *pool, StaticTable *table) {
    int bits = 0;
    while (bits < MOST_NEAR_BITS && 1 << bits < PARTS_A_SYMBOL * table->size) bits++;
    uint16_t *near = pool_take(pool, 2 << bits), symbol = 0;
    table->near = near, table->near_shift = PRECISION - bits;
    for (uint32_t part = 0; part < 1u << bits; part++) {
        while (table->sums[symbol + 1] <= part << table->near_shift) symbol++;
        near[part] = symbol;
    }
}

static uint32_t read_key(TableReader *reader, uint32_t before) {
    uint32_t key = 0;
    int same = 1;
    spend(&reader->numbers, 4);
    for (int i = 0; i < 4; i++) {
        const int64_t old = before >> (24 - 8 * i) & MOST_DIGIT;
        int64_t digit = next_number(&reader->numbers, &reader->digits[i][same]);
        if (same) digit += old + (i == 3);
        demand(digit <= MOST_DIGIT, "bad-table");
        same &= digit == old;
        key = key << 8 | (uint32_t)digit;
    }
    return key;
}

/* n values, ascending from at least -LARGEST on, as a signed number is. */
static const int32_t *read_alphabet(TableReader *reader, Pool *pool, int64_t kind, int64_t n) {
    spend(&reader->numbers, 1);
    int64_t value = next_signed(&reader->numbers, reader->first + kind);
    spend(&reader->numbers, n - 1);
    int32_t *values = pool_take(pool, 4 * n);
    values[0] = (int32_t)value;
    for (int64_t i = 1; i < n; i++) {
        value += (int64_t)next_number(&reader->numbers, reader->gaps + kind) + 1;
        values[i] = (int32_t)value;
    }
    demand(value <= LARGEST, "bad-table");
    return values;
}

static void read_table_weights(TableReader *reader, int64_t kind, int64_t n, uint32_t *weights) {
    const int64_t precision = read_limited(&reader->numbers, reader->precision + kind, WEIGHT_BITS - 1);
    uint32_t bits = 0;
    spend(&reader->numbers, n);
    for (int64_t i = 0; i < n; i++) {
        weights[i] = next_number(&reader->numbers, reader->weights + precision) + 1;
        bits |= weights[i];
    }
    demand(bits >> WEIGHT_BITS == 0, "bad-table");
}

static void read_record(TableReader *reader, Pool *pool, StaticTable *out) {
    const int64_t step = out->key >> 8 & MOST_DIGIT, kind = step < STEPS_APART ? step : STEPS_APART - 1;
    const int64_t size = read_limited(&reader->numbers, reader->more + kind, MOST_ALPHABET - 1) + 1;
    uint32_t weights[MOST_ALPHABET];
    weights[0] = 1;
    const int32_t *values = read_alphabet(reader, pool, kind, size);
    if (size > 1) read_table_weights(reader, kind, size, weights);
    uint32_t *sums = pool_take(pool, 4 * (size + 1));
    put_sums(weights, size, sums);
    *out = (StaticTable){.key = out->key, .size = (int32_t)size, .values = values, .sums = sums};
    if (size <= FEW) out->few = few_of(out);
    else find_near(pool, out);
}

/* The tables of a layer and those of the layer before, where the layer has none of their key (R-8.3-2). */
static void merge_tables(Model *m, int64_t k, const StaticTable *added, int64_t count) {
    const TablesInForce *before = m->tables + k - 1;
    TablesInForce *out = m->tables + k;
    out->tables = pool_take(&m->pool, (int64_t)sizeof *out->tables * (before->count + count));
    out->count = 0;
    for (int64_t i = 0, j = 0; i < before->count || j < count;) {
        const int old = j == count || (i < before->count && before->tables[i]->key < added[j].key);
        i += !old && i < before->count && before->tables[i]->key == added[j].key;
        out->tables[out->count++] = old ? before->tables[i++] : added + j++;
    }
}

/* The TABLES block of layer k, if it has one. */
void read_tables(Model *m, int64_t k) {
    const Body block = m->blocks[k][TABLES_BLOCK];
    if (!block.bytes) {
        m->tables[k] = m->tables[k - 1];
        return;
    }
    TableReader reader = {.numbers = open_numbers(m, block)};
    const int64_t count = read_once(&reader.numbers, MOST_TABLES);
    StaticTable *added = pool_take(&m->pool, (int64_t)sizeof *added * count);
    for (int64_t i = 0; i < count; i++) {
        added[i].key = read_key(&reader, i ? added[i - 1].key : 0);
        read_record(&reader, &m->pool, added + i);
    }
    seal_numbers(&reader.numbers);
    merge_tables(m, k, added, count);
}

/* The first table in force of a key not below this one. */
static int64_t find_table(const TablesInForce *tables, uint32_t key) {
    int64_t low = 0, high = tables->count;
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (tables->tables[middle]->key < key) low = middle + 1; else high = middle;
    }
    return low;
}

/* The tables in force in layer k of a step of components first.. of a stream. */
const Tables *pack_tables(Model *m, int64_t k, int64_t stream, int64_t first, int64_t components, int64_t step) {
    const TablesInForce *all = m->tables + k;
    Tables *out = pool_take(&m->pool, sizeof *out);
    const StaticTable **table = pool_zeros(&m->pool, components * KINDS * (int64_t)sizeof *table);
    for (int64_t c = 0; c < components; c++, table += KINDS) {
        const uint32_t key = (uint32_t)(stream << 24 | (first + c) << 16 | step << 8);
        for (int64_t at = find_table(all, key); at < all->count && all->tables[at]->key < key + KINDS; at++)
            table[all->tables[at]->key - key] = all->tables[at];
    }
    *out = (Tables){components * KINDS, table - components * KINDS};
    return out;
}

/* The steps of a channel that some class may receive in layer k. */
static void find_steps(Model *m, int64_t k, int64_t channel) {
    const int64_t *before = m->rows[k - 1].steps[channel], *after = m->rows[k].steps[channel];
    int64_t start = 0, stop = 0;
    for (int64_t c = 0; c < MOST_CLASSES; c++) {
        if (before[c] >= after[c]) continue;
        if (!start || before[c] + 1 < start) start = before[c] + 1;
        if (after[c] + 1 > stop) stop = after[c] + 1;
    }
    m->layer[k].start[channel] = start ? start : 1, m->layer[k].stop[channel] = start ? stop : 1;
}

/* Predictors of a step, all components side by side; NULL where none has one. */
static const Predictor *pack_predictors(Model *m, int64_t k, int64_t channel, int64_t step) {
    const PredictorsInForce *all = m->predictors + k;
    Predictor *out = NULL;
    for (int64_t i = 0; i < all->count; i++) {
        const PredictorModel *predictor = all->predictors[i];
        if (predictor->stream != m->channel[channel].stream || predictor->step != step) continue;
        if (!out) out = pool_zeros(&m->pool, (int64_t)sizeof *out * m->channel[channel].components);
        out[predictor->component] = predictor->packed;
    }
    return out;
}

static void pack_channel(Model *m, int64_t k, int64_t channel) {
    LayerModel *layer = m->layer + k;
    const ChannelModel *model = m->channel + channel;
    find_steps(m, k, channel);
    if (model->stream == OFFSETS) layer->start[channel] = 1, layer->stop[channel] = 2;
    const int64_t start = layer->start[channel], steps = layer->stop[channel] - start;
    layer->tables[channel] = pool_take(&m->pool, (int64_t)sizeof(Tables *) * steps);
    layer->predictors[channel] = pool_take(&m->pool, (int64_t)sizeof(Predictor *) * steps);
    int predicted = 0;
    for (int64_t n = 0; n < steps; n++) {
        layer->tables[channel][n] = pack_tables(m, k, model->stream, 0, model->components, start + n);
        layer->predictors[channel][n] = pack_predictors(m, k, channel, start + n);
        predicted |= layer->predictors[channel][n] != NULL;
    }
    if (!predicted) layer->predictors[channel] = NULL;
    layer->predicted |= predicted;
}

/* What tiles are read with in layer k. */
void pack_layer(Model *m, int64_t k) {
    LayerModel *layer = m->layer + k;
    layer->predicted = 0;
    for (int64_t i = 0; i < m->channels; i++) pack_channel(m, k, i);
    layer->positions = pack_tables(m, k, POSITIONS, 0, 1, 0);
    layer->classes = pack_tables(m, k, CLASSES, 0, 1, 0);
    layer->masks = m->profile == ANCHOR ? pack_tables(m, k, MASKS, 0, 1, 0) : NULL;
    for (int64_t stage = 1; stage <= MOST_STAGES; stage++) {
        int64_t received = 0;
        for (int64_t c = 0; c < MOST_CLASSES; c++)
            received |= m->rows[k - 1].stages[c] < stage && stage <= m->rows[k].stages[c];
        layer->indices[stage - 1] =
            received && !m->rows[k].mode ? pack_tables(m, k, INDICES, stage, 1, 0) : NULL;
    }
}
