/* Decoded context and predictors (SPEC 10.2, 10.3): what scarfmt/neural/context.py, predictors.py and
scarfmt/codecs/channels.py define. */

#include "kernel.h"

#define FINE_LIMIT 16777216.0
#define FINE_ONE 1024.0
#define AMAX 511
#define CLASSES 15
#define CLASS_INPUT 64.0f
#define KINDS 256     /* contexts of a component */
#define MOST_COMPONENTS 64
#define CLASS_KINDS 16
#define ROWS 4        /* rows of weights that it handles at once */
#define BAD_TRIT (-2)
#define VALUE_RANGE (-3)
#define VALUE_LIMIT 2147483647

static const double POWERS[20] = {
    1.0, 3.0, 9.0, 27.0, 81.0, 243.0, 729.0, 2187.0, 6561.0, 19683.0, 59049.0, 177147.0, 531441.0, 1594323.0,
    4782969.0, 14348907.0, 43046721.0, 129140163.0, 387420489.0, 1162261467.0};

INLINE double power_of(int64_t steps) { return POWERS[steps > 1 ? (steps > 20 ? 19 : steps - 1) : 0]; }

INLINE double fine(double value, int64_t steps) {
    if (steps <= 0) return 0;
    const double power = power_of(steps);
    const double scaled = floor_of((value * (2 * FINE_ONE) + power) / (2 * power));
    return scaled < -FINE_LIMIT ? -FINE_LIMIT : scaled > FINE_LIMIT ? FINE_LIMIT : scaled;
}

/* Fine values of (n, columns) `values` at (n,) `steps`. */
WIDE EXPORT void scar_fine(const int32_t *values, const int64_t *steps, int64_t n, int64_t columns, int64_t *out) {
    for (int64_t i = 0; i < n; i++)
        for (int64_t c = 0; c < columns; c++, values++, out++) *out = (int64_t)fine((double)*values, steps[i]);
}

INLINE void add_to_cells(const Cells *cells, int64_t anchor, int64_t column, double value) {
    for (int64_t d = 0; d < cells->depths; d++)
        cells->sums[d][cells->cell[d][anchor] * (cells->columns + 1) + column] += value;
}

/* Adds m anchors with (m, columns) integer `values`. */
EXPORT void scar_cells_add(const Cells *cells, const int64_t *anchors, int64_t m, const int64_t *values) {
    for (int64_t i = 0; i < m; i++) {
        for (int64_t c = 0; c < cells->columns; c++) add_to_cells(cells, anchors[i], c, (double)*values++);
        add_to_cells(cells, anchors[i], cells->columns, 1);
    }
}

/* (m, depths, columns) means around m anchors, and (m, depths) counts. */
WIDE EXPORT void scar_cells_around(const Cells *cells, const int64_t *anchors, int64_t m, double *means,
                                   double *counts) {
    const int64_t columns = cells->columns;
    for (int64_t i = 0; i < m; i++)
        for (int64_t d = 0; d < cells->depths; d++, means += columns, counts++) {
            for (int64_t c = 0; c < columns; c++) means[c] = d ? means[c - columns] : 0;
            *counts = cell_means(cells, d, anchors[i], means);
        }
}

INLINE float clamped(double value) { return (float)(value < -AMAX ? -AMAX : value > AMAX ? AMAX : value); }

INLINE float coarse_input(double value) { return clamped(floor_of(value * (1.0 / 64))); }

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
    int64_t by_class, low, shift, source_columns;
    const int32_t *source;           /* first-step values of the source's component, source_columns apart, or NULL */
} Rule;

/* One step of one channel in one tile-layer. */
typedef struct {
    int64_t step, components, settled_columns, shared, passes, predicted;
    const int64_t *classes;          /* (n) */
    const int64_t *settled;          /* (n, settled_columns) fine values */
    int32_t *values;                 /* (n, components) before and after */
    int32_t *first;                  /* (n, components), written in step 1 */
    int64_t *steps;                  /* (n) steps that values are at */
    const int64_t *anchors;          /* of all passes */
    const int64_t *ends;             /* (passes) where each ends among them */
    const Predictor *predictors;     /* (components); 0 rows: none */
    const Rule *rules;               /* (components) */
    Cells cells;                     /* empty */
    const Tables *tables;
    float *inputs;                   /* scratch: (widest pass in BLOCKs, width, BLOCK) */
    uint16_t *kind;                  /* scratch: (components, widest pass) */
    int32_t *symbols, *order;        /* scratch: as many each */
    int64_t *counts;                 /* scratch: tables->kinds + 1 */
    const int32_t *given;            /* (n, components) values after the step, to be written; NULL to read them */
    uint16_t *kinds_out;             /* writing: kinds and symbols, (anchors of all passes * components), */
    int32_t *symbols_out;            /* pass by pass and, in step 1, component by component */
} Step;

INLINE int64_t own_column(const Step *s) { return CLASSES + s->settled_columns; }

INLINE int64_t width_of(const Step *s) { return s->shared + s->components * s->cells.depths; }

INLINE void put_lane(float *x, int64_t row, double value) { x[row * BLOCK] = clamped(value); }

/* The inputs of one anchor into its lane of a block (SPEC 10.3). */
INLINE void anchor_inputs(const Step *s, int64_t anchor, float *x) {
    const int64_t components = s->components, depths = s->cells.depths;
    const int32_t *values = s->values + anchor * components;
    const double power = power_of(s->step), scale = 1.0 / 32;
    double mean[MOST_COMPONENTS], own[MOST_COMPONENTS], coarse[MOST_COMPONENTS], apart[MOST_COMPONENTS];
    for (int64_t c = 0; c < CLASSES; c++) x[c * BLOCK] = 0;
    x[s->classes[anchor] * BLOCK] = CLASS_INPUT;
    x += CLASSES * BLOCK;
    for (int64_t k = 0; k < s->settled_columns; k++, x += BLOCK)
        *x = coarse_input((double)s->settled[anchor * s->settled_columns + k]);
    for (int64_t c = 0; c < components; c++) own[c] = fine((double)values[c], s->step - 1), mean[c] = 0;
    for (int64_t c = 0; c < components; c++, x += BLOCK) *x = coarse_input(own[c]);
    float *counts = x + depths * components * BLOCK, *relative = counts + depths * BLOCK;
    for (int64_t d = 0; d < depths; d++) {
        counts[d * BLOCK] = count_feature(cell_means(&s->cells, d, anchor, mean));
        for (int64_t c = 0; c < components; c++) {
            coarse[c] = floor_of(mean[c] * (1.0 / 64));
            apart[c] = floor_of((mean[c] - own[c]) * power * scale + 0.5);
        }
        for (int64_t c = 0; c < components; c++) {
            put_lane(x, d * components + c, coarse[c]);
            put_lane(relative, c * depths + d, apart[c]);
        }
    }
}

WIDE static void pass_inputs(const Step *s, const int64_t *anchors, int64_t wide) {
    const int64_t size = width_of(s) * BLOCK;
    for (int64_t i = 0; i < wide; i++) anchor_inputs(s, anchors[i], s->inputs + i / BLOCK * size + i % BLOCK);
    /* Lanes beyond the last anchor: anything finite. */
    for (int64_t i = wide; i % BLOCK; i++)
        for (int64_t k = 0; k < width_of(s); k++) s->inputs[i / BLOCK * size + k * BLOCK + i % BLOCK] = 0;
}

/* Adds the products of ROWS rows of weights, `stride` apart, with n inputs. */
INLINE void add_products(const float *weights, int64_t stride, const float *x, int64_t n, Lanes out[ROWS]) {
    const Lanes *input = (const Lanes *)x;
    Lanes a = out[0], b = out[1], c = out[2], d = out[3];
    for (int64_t k = 0; k < n; k++, weights++) {
        a += weights[0] * input[k];
        b += weights[stride] * input[k];
        c += weights[2 * stride] * input[k];
        d += weights[3 * stride] * input[k];
    }
    out[0] = a, out[1] = b, out[2] = c, out[3] = d;
}

/* Adds what one row of a predictor gives to its two sums. */
INLINE void add_row(const Predictor *p, int64_t row, const Lanes *product, Lanes sums[2]) {
    const int64_t units = p->units;
    if (row >= units) {
        sums[row - units] += *product;
        return;
    }
    Lanes hidden = *product + p->biases[row];
    for (int j = 0; j < BLOCK; j++) {
        const float h = hidden[j] < 0 ? 0 : hidden[j] > AMAX ? AMAX : hidden[j];
        hidden[j] = (float)(int32_t)h;
    }
    sums[0] += p->output[row] * hidden;
    sums[1] += p->output[units + row] * hidden;
}

/* Context numbers of a component's symbols in a pass of `wide` anchors. */
WIDE static void predict(const Step *s, int64_t component, int64_t wide, uint16_t *kind) {
    const Predictor *p = s->predictors + component;
    const int64_t depths = s->cells.depths, width = s->shared + depths;
    for (int64_t i = 0; i < wide; i += BLOCK) {
        const float *x = s->inputs + i * width_of(s), *own = x + (s->shared + component * depths) * BLOCK;
        Lanes sums[2] = {{0}, {0}};
        for (int64_t row = 0; row < p->rows; row += ROWS) {
            Lanes out[ROWS] = {{0}, {0}, {0}, {0}};
            add_products(p->weights + row * width, width, x, s->shared, out);
            add_products(p->weights + row * width + s->shared, width, own, depths, out);
            for (int64_t r = 0; r < ROWS && row + r < p->units + 2; r++) add_row(p, row + r, out + r, sums);
        }
        for (int64_t j = 0; j < BLOCK && i + j < wide; j++) {
            int32_t bucket[2];
            for (int k = 0; k < 2; k++) {
                const float sum = sums[k][j] + p->output_biases[k];
                bucket[k] = (int32_t)(sum < 0 ? 0 : sum > p->last[k] ? p->last[k] : sum);
            }
            kind[i + j] = (uint16_t)(bucket[0] * (int32_t)(p->last[1] + 1) + bucket[1]);
        }
    }
}

/* Context numbers without a predictor (SPEC 8.4). */
static void follow_rule(const Step *s, int64_t component, const int64_t *anchors, int64_t wide, uint16_t *kind) {
    const Rule *rule = s->rules + component;
    for (int64_t i = 0; i < wide; i++) {
        int64_t number = 0;
        if (s->step > 1) {
            const int32_t value = s->values[anchors[i] * s->components + component];
            number = (value < -2 ? -2 : value > 2 ? 2 : value) + 2;
        } else if (rule->source) {
            number = (rule->source[anchors[i] * rule->source_columns] - rule->low) >> rule->shift;
            number = number < 0 ? 0 : number >= CLASS_KINDS ? CLASS_KINDS - 1 : number;
        }
        if (rule->by_class) number += s->classes[anchors[i]] * CLASS_KINDS;
        kind[i] = (uint16_t)number;
    }
}

/* Symbols of components first..past - 1 of a pass, from values that are known; whether all are such as can be read. */
static int given_symbols(const Step *s, const int64_t *anchors, int64_t wide, int64_t first, int64_t past) {
    for (int64_t c = first; c < past; c++)
        for (int64_t i = 0; i < wide; i++) {
            const int64_t at = anchors[i] * s->components + c;
            const int64_t before = s->step > 1 ? 3 * (int64_t)s->values[at] : 0;
            const int64_t symbol = s->given[at] - before;
            if (s->step > 1 && (symbol < -1 || symbol > 1)) return 0;
            s->symbols_out[(c - first) * wide + i] = (int32_t)symbol;
        }
    return 1;
}

/* Reads or writes components first..past - 1 of a pass; ALL_READ or what is wrong. */
static int64_t code_components(Rans *rans, Step *s, const int64_t *anchors, int64_t wide, int64_t first,
                               int64_t past) {
    for (int64_t c = first; c < past; c++) {
        uint16_t *kind = s->kind + (c - first) * wide;
        if (s->predictors[c].rows)
            predict(s, c, wide, kind);
        else
            follow_rule(s, c, anchors, wide, kind);
        for (int64_t i = 0; i < wide; i++) kind[i] = (uint16_t)(kind[i] + (c - first) * KINDS);
    }
    const int64_t n = (past - first) * wide;
    const int32_t *symbols = s->symbols;
    if (s->given) {
        if (!given_symbols(s, anchors, wide, first, past)) return BAD_TRIT;
        for (int64_t i = 0; i < n; i++) s->kinds_out[i] = (uint16_t)(s->kind[i] + first * KINDS);
        symbols = s->symbols_out;
        s->kinds_out += n, s->symbols_out += n;
    } else {
        /* Kinds of these components alone: clearing and walking those of all would take longer than reading few. */
        Tables tables = *s->tables;
        tables.kinds = (past - first) * KINDS;
        tables.number += first * KINDS;
        tables.used += first * KINDS;
        const int64_t read = scar_rans_grouped(rans, &tables, s->kind, n, s->counts, s->order, s->symbols);
        if (read != ALL_READ) return read + first * KINDS;
    }
    if (s->step > 1)
        for (int64_t i = 0; i < n; i++)
            if (symbols[i] < -1 || symbols[i] > 1) return BAD_TRIT;
    for (int64_t c = first; c < past; c++)
        for (int64_t i = 0; i < wide; i++) {
            int32_t *value = s->values + anchors[i] * s->components + c;
            int64_t now = symbols[(c - first) * wide + i];
            if (s->step > 1) now += 3 * (int64_t)*value;
            if (now < -VALUE_LIMIT || now > VALUE_LIMIT) return VALUE_RANGE;
            *value = (int32_t)now;
            if (s->step == 1) s->first[anchors[i] * s->components + c] = (int32_t)now;
        }
    return ALL_READ;
}

/* In step 1, what was just read is an input of the components after it. */
static void tell_component(const Step *s, int64_t component, const int64_t *anchors, int64_t wide) {
    const int64_t size = width_of(s) * BLOCK, column = (own_column(s) + component) * BLOCK;
    for (int64_t i = 0; i < wide; i++)
        s->inputs[i / BLOCK * size + column + i % BLOCK] =
            coarse_input(fine((double)s->values[anchors[i] * s->components + component], 1));
}

INLINE void add_anchor(const Step *s, int64_t anchor) {
    for (int64_t c = 0; c < s->components; c++)
        add_to_cells(&s->cells, anchor, c, fine((double)s->values[anchor * s->components + c], s->steps[anchor]));
    add_to_cells(&s->cells, anchor, s->components, 1);
}

/* Reads or writes one step of a channel, pass by pass (SPEC 7.5, 10.3), in a tile-layer of `count` anchors.

Returns ALL_READ, BAD_TRIT, VALUE_RANGE, or a kind (component * 256 + context) without a table. */
EXPORT int64_t scar_channel_step(Rans *rans, Step *s, int64_t count) {
    if (s->predicted)
        for (int64_t anchor = 0; anchor < count; anchor++)
            if (s->steps[anchor] >= s->step) add_anchor(s, anchor);
    int64_t start = 0;
    for (int64_t pass = 0; pass < s->passes; start = s->ends[pass++]) {
        const int64_t *anchors = s->anchors + start;
        const int64_t wide = s->ends[pass] - start;
        if (!wide) continue;
        if (s->predicted) pass_inputs(s, anchors, wide);
        /* The components of a first step are context for each other; later steps need no component's news. */
        const int64_t together = s->step == 1 ? 1 : s->components;
        for (int64_t c = 0; c < s->components; c += together) {
            const int64_t read = code_components(rans, s, anchors, wide, c, c + together);
            if (read != ALL_READ) return read;
            if (s->predicted && s->step == 1) tell_component(s, c, anchors, wide);
        }
        for (int64_t i = 0; i < wide; i++) {
            s->steps[anchors[i]] = s->step;
            if (s->predicted) add_anchor(s, anchors[i]);
        }
    }
    return ALL_READ;
}
