/* The tiles of composite.h, compiled once for every kind of vectors (vectors.h). The file that includes this one says which,
and what they are called: TILES. */

#include "composite.h"
#include "vectors.h"

#define STRIDE (TILE + LANES) /* of a row of a tile: a span that starts in the tile may end beyond it */
#define PIXELS (TILE * STRIDE)
#define EARLY 8
#define FEW_ROWS 5 /* up to so many, rows are looked at one by one */
#define CHECK_EVERY 16 /* splats between two looks at whether any pixel of the tile is still open */
/* The bounds of a row are widened by so much, so that rounding never drops a pixel; alphas decide. */
#define SLACK_PX 2e-3f
#define SLACK 1e-6f
#define HALF_LOG2_E 0.72134752f /* half a square in natural exponents, as an exponent of two */
/* Under any exponent of 2 that shows, and well over the smallest that binary32 has. */
#define LEAST_EXPONENT (-32.0f)

/* What a splat may reach of a tile, and what depends on the row alone. */
typedef struct {
    uint32_t spans;       /* bit r: LANES pixels of row r, from `first` on; bit TILE + r: the LANES after them */
    int32_t first[TILE];  /* column */
    float dy[TILE];       /* rows from the mean */
    float ridge[TILE];    /* columns from the ridge of the splat to the first pixel that it may reach */
    float exponent[TILE]; /* on the ridge */
} Reach;

/* A closed pixel has the transmittance that it closed with, negated; so have pixels beyond the picture. */
typedef struct {
    float transmittance[PIXELS], red[PIXELS], green[PIXELS], blue[PIXELS];
} Blend;

/* behind: the product of the gradient with the colour behind what has been blended. */
typedef struct {
    float transmittance[PIXELS], behind[PIXELS], red[PIXELS], green[PIXELS], blue[PIXELS];
} Unblend;

typedef struct {
    int64_t left, top, wide, high;
} Place;

PART V kept(M mask, V value) { return (V)(mask & (M)value); }

PART float sum(V value) {
    typedef float Half __attribute__((vector_size(2 * LANES)));
    Half low, high;
    memcpy(&low, &value, sizeof low);
    memcpy(&high, (const char *)&value + sizeof low, sizeof high);
    low += high;
    return (low[0] + low[1]) + (low[2] + low[3]);
}

/* 2^t for LEAST_EXPONENT <= t <= 0 to 1e-7 (a polynomial of least relative error on -1/2..1/2). */
PART V power_of_two(V t) {
    const float magic = 12582912.0f; /* 1.5 * 2^23: adding it rounds to a whole number, in the low bits */
    V shifted = t + magic;
    V f = t - (shifted - magic);
    V p = all(0.001327647129073739f) * f + 0.009675541892647743f;
    p = p * f + 0.05550713464617729f;
    p = p * f + 0.24022120237350464f;
    p = p * f + 0.6931469440460205f;
    p = p * f + 1.0000001192092896f;
    return (V)((M)p + ((M)shifted << 23));
}

/* A splat's alpha before the cap, at u columns from its ridge in a row with this exponent. */
PART V uncapped(V u, float across, float row) {
    V t = row - across * u * u;
    return power_of_two(larger(t, all(LEAST_EXPONENT)));
}

PART V capped(const Job *job, V alpha) {
    V below = smaller(alpha, all(job->max_alpha));
    return kept(below >= all(job->min_alpha), below);
}

/* Blends alpha over pixels: the weight that it has there. */
PART V shade(const Job *job, V alpha, float *transmittance) {
    V before = load(transmittance);
    V weight = alpha * before;
    V after = before - weight;
    M open = after >= all(job->min_transmittance);
    V closed = (V)((M)before | (M)all(-0.0f));
    store(transmittance, where(open, after, closed));
    return kept(open, weight);
}

PART Place place_of(const Job *job, int64_t tile) {
    Place p = {tile % job->columns * TILE, tile / job->columns * TILE, TILE, TILE};
    if (p.wide > job->width - p.left) p.wide = job->width - p.left;
    if (p.high > job->height - p.top) p.high = job->height - p.top;
    return p;
}

static const V COLUMNS = {0, 1, 2, 3, 4, 5, 6, 7};

/* The rows of a splat that is no wider than LANES, one by one; 0 if it is wider, or higher than a few rows. */
PART int find_small_reach(const Splat *s, const Place *p, Reach *r) {
    float x = s->mean_x - p->left - 0.5f, y = s->mean_y - p->top - 0.5f, most = TILE - 1;
    float left = x - s->ellipse.half_x, right = x + s->ellipse.half_x, top = y - s->ellipse.half_y,
          bottom = y + s->ellipse.half_y;
    if (!(right - left < LANES - 1 && bottom - top < FEW_ROWS)) return 0;
    int32_t first = left > 0 ? (int32_t)(left + 0.999f) : 0, row = top > 0 ? (int32_t)(top + 0.999f) : 0;
    int32_t last = bottom < 0 ? -1 : bottom > most ? TILE - 1 : (int32_t)bottom;
    float down = HALF_LOG2_E * s->ellipse.down;
    r->spans = 0;
    if (first >= TILE || right < 0) return 1;
    for (; row <= last; row++) {
        float dy = (float)row - y;
        r->spans |= 1u << row;
        r->first[row] = first;
        r->dy[row] = dy;
        r->ridge[row] = (float)first - (s->ellipse.slope * dy + x);
        r->exponent[row] = s->ellipse.log_opacity - down * dy * dy;
    }
    return 1;
}

PART void find_reach(const Splat *s, const Place *p, Reach *r) {
    if (find_small_reach(s, p, r)) return;
    float per_half = 1.0f / s->ellipse.half_y, down = HALF_LOG2_E * s->ellipse.down;
    V none = all(0.0f), last_column = all(TILE - 1);
    r->spans = 0;
    for (int row = 0; row < TILE; row += LANES) {
        V dy = COLUMNS + (p->top + row + 0.5f - s->mean_y), height = dy * per_half, part = 1.0f + SLACK - height * height;
        V half = s->ellipse.half_row * root(larger(part, none)) + SLACK_PX;
        V middle = s->ellipse.slope * dy + (s->mean_x - p->left - 0.5f);
        /* Rounded up and down; either may be one too generous. */
        M first = __builtin_convertvector(smaller(larger(middle - half, none), all(TILE)) + 0.999f, M);
        M last = __builtin_convertvector(larger(smaller(middle + half, last_column), all(-1.0f)) + 1.0f, M) - 1;
        M reached = (part >= none) & (first <= last), twice = reached & (first + LANES <= last);
        r->spans |= signs(reached) << row | signs(twice) << (TILE + row);
        memcpy(r->first + row, &first, sizeof first);
        store(r->dy + row, dy);
        store(r->ridge + row, __builtin_convertvector(first, V) - middle);
        store(r->exponent + row, s->ellipse.log_opacity - down * dy * dy);
    }
}

PART void open_pixels(float *transmittance, const Place *p) {
    for (int row = 0; row < TILE; row++)
        for (int column = 0; column < STRIDE; column++)
            transmittance[row * STRIDE + column] = row < p->high && column < p->wide ? 1.0f : -1.0f;
}

PART int any_open(const float *transmittance) {
    int32_t closed = -1;
    for (int i = 0; i < PIXELS; i++) {
        int32_t word;
        memcpy(&word, transmittance + i, sizeof word);
        closed &= word;
    }
    return closed >= 0;
}

/* Splats of a tile lie far apart: the next ones are asked for early. */
PART void prefetch(const Job *job, int64_t k, int64_t past) {
    if (k + EARLY < past) __builtin_prefetch(job->splats + job->owners[k + EARLY]);
}

PART float blend(const Job *job, const Splat *s, const Place *p, Blend *b) {
    Reach reach;
    float across = HALF_LOG2_E * s->ellipse.across;
    find_reach(s, p, &reach);
    V weights = {0};
    for (uint32_t spans = reach.spans; spans; spans &= spans - 1) {
        int32_t bit = __builtin_ctz(spans), row = bit % TILE, later = bit / TILE * LANES;
        int32_t i = row * STRIDE + reach.first[row] + later;
        V u = COLUMNS + (reach.ridge[row] + later);
        if (!signs(load(b->transmittance + i) > 0.0f)) continue;
        V alpha = capped(job, uncapped(u, across, reach.exponent[row]));
        V weight = shade(job, alpha, b->transmittance + i);
        store(b->red + i, load(b->red + i) + weight * s->red);
        store(b->green + i, load(b->green + i) + weight * s->green);
        store(b->blue + i, load(b->blue + i) + weight * s->blue);
        weights += weight;
    }
    return sum(weights);
}

PART void finish(const Job *job, const Place *p, const Blend *b) {
    for (int64_t row = 0; row < p->high; row++)
        for (int64_t column = 0; column < p->wide; column++) {
            int64_t i = row * STRIDE + column, pixel = (p->top + row) * job->width + p->left + column;
            float left = __builtin_fabsf(b->transmittance[i]), *colour = job->image + 3 * pixel;
            colour[0] = b->red[i] + left * job->background[0];
            colour[1] = b->green[i] + left * job->background[1];
            colour[2] = b->blue[i] + left * job->background[2];
            job->transmittance[pixel] = left;
        }
}

/* Blends the splats of a tile until all pixels are closed; fills weights and drawn. */
PART void blend_splats(const Job *job, int64_t tile, const Place *p, Blend *b) {
    open_pixels(b->transmittance, p);
    int64_t first = job->offsets[tile], past = job->offsets[tile + 1], k = first;
    for (; k < past; k++) {
        if ((k - first) % CHECK_EVERY == 0 && !any_open(b->transmittance)) break;
        prefetch(job, k, past);
        float weight = blend(job, job->splats + job->owners[k], p, b);
        if (job->weights) job->weights[job->listed[k]] = weight;
    }
    job->drawn[tile] = (int32_t)(k - first);
    if (job->weights)
        for (; k < past; k++) job->weights[job->listed[k]] = 0.0f;
}

static void __attribute__((TARGET)) blend_tile(const Job *job, int64_t tile) {
    Place p = place_of(job, tile);
    Blend b = {0};
    blend_splats(job, tile, &p, &b);
    finish(job, &p, &b);
}

/* The colour behind a splat, of which transmittance `after` is left: what is finished less what is in front. */
PART V contrast(float colour, const float *left, V share) {
    V over = colour - load(left) * share;
    return over * over;
}

/* Blends a splat again; `left` begins as the finished colours, and blended ones are taken from it. */
PART void measure(const Job *job, const Splat *s, const Place *p, Blend *left, float *out) {
    Reach reach;
    float across = HALF_LOG2_E * s->ellipse.across;
    find_reach(s, p, &reach);
    V squares = {0}, contrasts = {0}, largest = {0};
    for (uint32_t spans = reach.spans; spans; spans &= spans - 1) {
        int32_t bit = __builtin_ctz(spans), row = bit % TILE, later = bit / TILE * LANES;
        int32_t i = row * STRIDE + reach.first[row] + later;
        V u = COLUMNS + (reach.ridge[row] + later), before = load(left->transmittance + i);
        if (!signs(before > 0.0f)) continue;
        V alpha = capped(job, uncapped(u, across, reach.exponent[row]));
        V weight = shade(job, alpha, left->transmittance + i);
        store(left->red + i, load(left->red + i) - weight * s->red);
        store(left->green + i, load(left->green + i) - weight * s->green);
        store(left->blue + i, load(left->blue + i) - weight * s->blue);
        V share = 1.0f / larger(before - weight, all(job->min_transmittance)), square = weight * weight;
        squares += square;
        contrasts += square * (contrast(s->red, left->red + i, share) + contrast(s->green, left->green + i, share) +
                               contrast(s->blue, left->blue + i, share));
        largest = larger(largest, weight);
    }
    float most = 0;
    for (int i = 0; i < LANES; i++) most = largest[i] > most ? largest[i] : most;
    out[0] = sum(squares), out[1] = sum(contrasts), out[2] = most;
}

static void __attribute__((TARGET)) measure_tile(const Job *job, int64_t tile) {
    Place p = place_of(job, tile);
    Blend b = {0};
    blend_splats(job, tile, &p, &b);
    open_pixels(b.transmittance, &p);
    int64_t first = job->offsets[tile], past = first + job->drawn[tile];
    for (int64_t k = first; k < past; k++) {
        prefetch(job, k, past);
        int64_t number = job->listed[k];
        if (job->weights[number] > 0)
            measure(job, job->splats + job->owners[k], &p, &b, job->measures + MEASURES * number);
    }
}

/* A splat's colour, and then moments of the gradient of the exponent (per natural exponent): its sum, sums with u, u dy,
u^2, dy and dy^2, for u columns from the ridge and dy rows from the mean. */
PART void unblend(const Job *job, const Splat *s, const Place *p, Unblend *b, float *out) {
    Reach reach;
    float across = HALF_LOG2_E * s->ellipse.across;
    find_reach(s, p, &reach);
    V red = {0}, green = {0}, blue = {0}, m = {0}, m_u = {0}, m_u_dy = {0}, m_u_u = {0}, m_dy = {0}, m_dy_dy = {0};
    for (uint32_t spans = reach.spans; spans; spans &= spans - 1) {
        int32_t bit = __builtin_ctz(spans), row = bit % TILE, later = bit / TILE * LANES;
        int32_t i = row * STRIDE + reach.first[row] + later;
        float dy = reach.dy[row];
        V u = COLUMNS + (reach.ridge[row] + later);
        V raw = uncapped(u, across, reach.exponent[row]), alpha = capped(job, raw);
        V before = load(b->transmittance + i), weight = shade(job, alpha, b->transmittance + i);
        if (!signs(weight > 0.0f)) continue;
        V to_red = load(b->red + i), to_green = load(b->green + i), to_blue = load(b->blue + i);
        V own = to_red * s->red + to_green * s->green + to_blue * s->blue;
        V behind = load(b->behind + i) - weight * own;
        store(b->behind + i, behind);
        red += weight * to_red;
        green += weight * to_green;
        blue += weight * to_blue;
        /* Where the cap holds, or nothing was blended, nothing moves. */
        M moves = (weight > 0.0f) & (raw <= all(job->max_alpha));
        V moved = kept(moves, (before * own - behind / (1.0f - alpha)) * alpha), moved_u = moved * u;
        m += moved;
        m_u += moved_u;
        m_u_u += moved_u * u;
        m_u_dy += moved_u * dy;
        m_dy += moved * dy;
        m_dy_dy += moved * (dy * dy);
    }
    const V sums[GRADIENTS] = {red, green, blue, m, m_u, m_u_dy, m_u_u, m_dy, m_dy_dy};
    for (int i = 0; i < GRADIENTS; i++) out[i] = sum(sums[i]);
}

PART void start_back(const Job *job, const Place *p, Unblend *b) {
    for (int64_t row = 0; row < p->high; row++)
        for (int64_t column = 0; column < p->wide; column++) {
            int64_t i = row * STRIDE + column, pixel = (p->top + row) * job->width + p->left + column;
            const float *colour = job->image + 3 * pixel, *towards = job->towards + 3 * pixel;
            b->red[i] = towards[0];
            b->green[i] = towards[1];
            b->blue[i] = towards[2];
            b->behind[i] = towards[0] * colour[0] + towards[1] * colour[1] + towards[2] * colour[2];
        }
}

static void __attribute__((TARGET)) unblend_tile(const Job *job, int64_t tile) {
    Place p = place_of(job, tile);
    Unblend b = {0};
    open_pixels(b.transmittance, &p);
    start_back(job, &p, &b);
    int64_t first = job->offsets[tile], past = job->offsets[tile + 1], k = first;
    for (; k < first + job->drawn[tile]; k++) {
        prefetch(job, k, past);
        float *gradients = job->gradients + GRADIENTS * (int64_t)job->listed[k];
        unblend(job, job->splats + job->owners[k], &p, &b, gradients);
    }
    for (; k < past; k++) memset(job->gradients + GRADIENTS * (int64_t)job->listed[k], 0, GRADIENTS * sizeof(float));
}

const Pass TILES[PASSES] = {[BLEND] = blend_tile, [MEASURE] = measure_tile, [UNBLEND] = unblend_tile};
