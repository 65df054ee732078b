/* Splats blended over the tiles of a picture, and the gradient of that, in binary32.

The image model is that of scarfmt/render/rasterise.py, whose constants come as arguments. Exponents are sums of two
squares (Splat), which float32 bears: the usual a dx dx + 2 b dx dy + c dy dy cancels in long thin splats.

Threads take tiles from a common counter. What a tile computes does not depend on the thread, and no two tiles write the
same number, so results are the same bits whatever the number of threads. No function allocates. */

#include <stdint.h>
#include <string.h>

#include "../../../scarfmt/kernel/compiler.h"

/* Grows with every change of Job or of what its arrays hold: loading.py loads no other. */
#define INTERFACE 1
#define TILE 16
#define SPAN 8               /* columns worked on together */
#define STRIDE (TILE + SPAN) /* of a row of a tile: a span that starts in the tile may end beyond it */
#define PIXELS (TILE * STRIDE)
#define GRADIENTS 9
#define CHECK_EVERY 16 /* splats between two looks at whether any pixel of the tile is still open */
/* The bounds of a row are widened by so much, so that rounding never drops a pixel: they are exact tests' first sieve. */
#define SLACK_PX 2e-3f
#define SLACK 1e-6f
/* Under any exponent of 2 that shows, and well over the smallest that binary32 has. */
#define LEAST_EXPONENT (-32.0f)

typedef float V __attribute__((vector_size(4 * SPAN)));
typedef int32_t M __attribute__((vector_size(4 * SPAN)));
typedef float Half __attribute__((vector_size(2 * SPAN)));

/* alpha = 2^(log_opacity - (across (dx - slope dy)^2 + down dy^2)), capped; pixels and 1/pixels^2. */
typedef struct {
    float mean_x, mean_y, across, slope, down, log_opacity, red, green, blue;
    float half_row, half_y; /* furthest columns from the mean in the row of the mean, and rows */
    float spare;
} Splat;

/* Everything that a call is given; composite.py fills it. Intersections are pairs of a tile and a splat that may show
in it: numbered splat by splat, and listed tile by tile, nearest first. */
typedef struct {
    int64_t width, height, columns, tiles;
    float max_alpha, min_alpha, min_transmittance;
    float background[3];
    const Splat *splats;
    const int64_t *offsets;   /* (tiles + 1,) where the list of a tile starts */
    const int32_t *listed;    /* (intersections,) numbers */
    const int32_t *owners;    /* (intersections,) splats, by number */
    float *image;             /* (height, width, 3) */
    float *transmittance;     /* (height, width) what is left for the background */
    float *weights;           /* (intersections,) sums of alpha times transmittance, by number */
    int32_t *drawn;           /* (tiles,) splats blended before all pixels were closed */
    const float *towards;     /* (height, width, 3) gradient of the picture */
    float *gradients;         /* (intersections, GRADIENTS), by number */
} Job;

/* Columns of a tile that a splat may reach, row by row; none where last < first. */
typedef struct {
    int32_t first_row, last_row;
    int32_t first[TILE], last[TILE];
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

INLINE float least(float a, float b) { return a < b ? a : b; }
INLINE float most(float a, float b) { return a > b ? a : b; }

INLINE V load(const float *from) {
    V value;
    memcpy(&value, from, sizeof value);
    return value;
}

INLINE void store(float *to, V value) { memcpy(to, &value, sizeof value); }
INLINE V all(float value) { return value - (V){0}; }
INLINE V bits(M mask) { return (V)mask; }
INLINE V where(M mask, V yes, V no) { return bits((mask & (M)yes) | (~mask & (M)no)); }
INLINE V kept(M mask, V value) { return bits(mask & (M)value); }

INLINE float sum(V value) {
    Half low, high;
    memcpy(&low, &value, sizeof low);
    memcpy(&high, (const char *)&value + sizeof low, sizeof high);
    low += high;
    return (low[0] + low[1]) + (low[2] + low[3]);
}

/* 2^t for LEAST_EXPONENT <= t <= 0 to 1e-7 (a polynomial of least relative error on -1/2..1/2). */
INLINE V power_of_two(V t) {
    const float magic = 12582912.0f; /* 1.5 * 2^23: adding it rounds to a whole number, in the low bits */
    V shifted = t + magic;
    V f = t - (shifted - magic);
    V p = all(0.001327647129073739f) * f + 0.009675541892647743f;
    p = p * f + 0.05550713464617729f;
    p = p * f + 0.24022120237350464f;
    p = p * f + 0.6931469440460205f;
    p = p * f + 1.0000001192092896f;
    return bits((M)p + ((M)shifted << 23));
}

/* A splat's alpha before the cap, at u columns from its ridge in a row with this exponent. */
INLINE V uncapped(V u, float across, float row) {
    V t = row - across * u * u;
    return power_of_two(where(t > all(LEAST_EXPONENT), t, all(LEAST_EXPONENT)));
}

INLINE V capped(const Job *job, V alpha) {
    V below = where(alpha < all(job->max_alpha), alpha, all(job->max_alpha));
    return kept(below >= all(job->min_alpha), below);
}

/* Blends alpha over pixels: the weight that it has there. */
INLINE V shade(const Job *job, V alpha, float *transmittance) {
    V before = load(transmittance);
    V weight = alpha * before;
    V after = before - weight;
    M open = after >= all(job->min_transmittance);
    V closed = bits((M)before | (M)all(-0.0f));
    store(transmittance, where(open, after, closed));
    return kept(open, weight);
}

INLINE Place place_of(const Job *job, int64_t tile) {
    Place p = {tile % job->columns * TILE, tile / job->columns * TILE, TILE, TILE};
    if (p.wide > job->width - p.left) p.wide = job->width - p.left;
    if (p.high > job->height - p.top) p.high = job->height - p.top;
    return p;
}

/* The first whole number not under x, and the last not over it; both may be one too generous. */
INLINE int32_t from(float x) { return (int32_t)(least(most(x, 0.0f), TILE) + 0.999f); }
INLINE int32_t to(float x) { return (int32_t)(least(most(x, -1.0f), TILE - 1) + 1.0f) - 1; }

INLINE void find_reach(const Splat *s, const Place *p, Reach *r) {
    float dx = s->mean_x - p->left - 0.5f, dy = p->top + 0.5f - s->mean_y;
    float per_half = 1.0f / s->half_y;
    r->first_row = from(-dy - s->half_y);
    r->last_row = to(-dy + s->half_y);
    for (int row = 0; row < TILE; row++) {
        float height = (dy + row) * per_half, part = 1.0f + SLACK - height * height;
        float half = s->half_row * __builtin_sqrtf(most(part, 0.0f)) + SLACK_PX, middle = dx + s->slope * (dy + row);
        r->first[row] = from(middle - half);
        r->last[row] = part < 0.0f ? -1 : to(middle + half);
    }
}

static const V LANES = {0, 1, 2, 3, 4, 5, 6, 7};

/* Columns from the ridge of a splat of those pixels of a row that start at `column`. */
INLINE V from_ridge(const Splat *s, const Place *p, int32_t column, float dy) {
    return LANES + (p->left + column + 0.5f - s->mean_x - s->slope * dy);
}

INLINE void open_pixels(float *transmittance, const Place *p) {
    for (int row = 0; row < TILE; row++)
        for (int column = 0; column < STRIDE; column++)
            transmittance[row * STRIDE + column] = row < p->high && column < p->wide ? 1.0f : -1.0f;
}

INLINE int any_open(const float *transmittance) {
    int32_t closed = -1;
    for (int i = 0; i < PIXELS; i++) {
        int32_t word;
        memcpy(&word, transmittance + i, sizeof word);
        closed &= word;
    }
    return closed >= 0;
}

INLINE float blend(const Job *job, const Splat *s, const Place *p, Blend *b) {
    Reach reach;
    find_reach(s, p, &reach);
    V weights = {0};
    for (int row = reach.first_row; row <= reach.last_row; row++) {
        float dy = p->top + row + 0.5f - s->mean_y, exponent = s->log_opacity - s->down * dy * dy;
        for (int32_t column = reach.first[row]; column <= reach.last[row]; column += SPAN) {
            int32_t i = row * STRIDE + column;
            V alpha = capped(job, uncapped(from_ridge(s, p, column, dy), s->across, exponent));
            V weight = shade(job, alpha, b->transmittance + i);
            store(b->red + i, load(b->red + i) + weight * s->red);
            store(b->green + i, load(b->green + i) + weight * s->green);
            store(b->blue + i, load(b->blue + i) + weight * s->blue);
            weights += weight;
        }
    }
    return sum(weights);
}

INLINE void finish(const Job *job, const Place *p, const Blend *b) {
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

INLINE void blend_tile(const Job *job, int64_t tile) {
    Place p = place_of(job, tile);
    Blend b = {0};
    open_pixels(b.transmittance, &p);
    int64_t first = job->offsets[tile], past = job->offsets[tile + 1], k = first;
    for (; k < past; k++) {
        if ((k - first) % CHECK_EVERY == 0 && !any_open(b.transmittance)) break;
        int32_t number = job->listed[k];
        job->weights[number] = blend(job, job->splats + job->owners[number], &p, &b);
    }
    job->drawn[tile] = (int32_t)(k - first);
    for (; k < past; k++) job->weights[job->listed[k]] = 0.0f;
    finish(job, &p, &b);
}

/* A splat's colour, and then moments of the gradient of the exponent (per natural exponent): its sum, sums with u, u dy,
u^2, dy and dy^2, for u columns from the ridge and dy rows from the mean. */
INLINE void unblend(const Job *job, const Splat *s, const Place *p, Unblend *b, float *out) {
    Reach reach;
    find_reach(s, p, &reach);
    V red = {0}, green = {0}, blue = {0}, m = {0}, m_u = {0}, m_u_dy = {0}, m_u_u = {0}, m_dy = {0}, m_dy_dy = {0};
    for (int row = reach.first_row; row <= reach.last_row; row++) {
        float dy = p->top + row + 0.5f - s->mean_y, exponent = s->log_opacity - s->down * dy * dy;
        V row_m = {0}, row_m_u = {0};
        for (int32_t column = reach.first[row]; column <= reach.last[row]; column += SPAN) {
            int32_t i = row * STRIDE + column;
            V u = from_ridge(s, p, column, dy), raw = uncapped(u, s->across, exponent), alpha = capped(job, raw);
            V before = load(b->transmittance + i), weight = shade(job, alpha, b->transmittance + i);
            V to_red = load(b->red + i), to_green = load(b->green + i), to_blue = load(b->blue + i);
            V own = to_red * s->red + to_green * s->green + to_blue * s->blue;
            V behind = load(b->behind + i) - weight * own;
            store(b->behind + i, behind);
            red += weight * to_red;
            green += weight * to_green;
            blue += weight * to_blue;
            /* Where the cap holds, or nothing was blended, nothing moves. */
            M moves = (weight > 0.0f) & (raw <= all(job->max_alpha));
            V moved = kept(moves, (before * own - behind / (1.0f - alpha)) * alpha);
            row_m += moved;
            row_m_u += moved * u;
            m_u_u += moved * u * u;
        }
        m += row_m;
        m_u += row_m_u;
        m_u_dy += row_m_u * dy;
        m_dy += row_m * dy;
        m_dy_dy += row_m * (dy * dy);
    }
    const V sums[GRADIENTS] = {red, green, blue, m, m_u, m_u_dy, m_u_u, m_dy, m_dy_dy};
    for (int i = 0; i < GRADIENTS; i++) out[i] = sum(sums[i]);
}

INLINE void start_back(const Job *job, const Place *p, Unblend *b) {
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

INLINE void unblend_tile(const Job *job, int64_t tile) {
    Place p = place_of(job, tile);
    Unblend b = {0};
    open_pixels(b.transmittance, &p);
    start_back(job, &p, &b);
    int64_t first = job->offsets[tile], past = job->offsets[tile + 1], k = first;
    for (; k < first + job->drawn[tile]; k++) {
        int64_t number = job->listed[k];
        unblend(job, job->splats + job->owners[number], &p, &b, job->gradients + GRADIENTS * number);
    }
    for (; k < past; k++) memset(job->gradients + GRADIENTS * (int64_t)job->listed[k], 0, GRADIENTS * sizeof(float));
}

EXPORT int64_t scar_composite_interface(void) { return INTERFACE; }
EXPORT int64_t scar_composite_tile(void) { return TILE; }
EXPORT int64_t scar_composite_job(void) { return sizeof(Job); }

/* Fills image, transmittance, weights and drawn of the tiles that it takes: numbers from `next` up. */
WIDE EXPORT void scar_composite(const Job *job, int64_t *next) {
    for (int64_t tile; (tile = __atomic_fetch_add(next, 1, __ATOMIC_RELAXED)) < job->tiles;) blend_tile(job, tile);
}

/* Fills the gradients of the tiles that it takes; the picture and `drawn` are those that scar_composite left. */
WIDE EXPORT void scar_composite_back(const Job *job, int64_t *next) {
    for (int64_t tile; (tile = __atomic_fetch_add(next, 1, __ATOMIC_RELAXED)) < job->tiles;) unblend_tile(job, tile);
}

/* Adds the rows (of `wide` numbers) of splats `first` to `past`, those of splat i being starts[i] up to starts[i + 1]. */
WIDE EXPORT void scar_composite_gather(const float *rows, int64_t wide, const int64_t *starts, int64_t first, int64_t past,
                                       float *sums) {
    for (int64_t i = first; i < past; i++) {
        float *out = sums + i * wide;
        for (int64_t c = 0; c < wide; c++) out[c] = 0.0f;
        for (int64_t r = starts[i]; r < starts[i + 1]; r++)
            for (int64_t c = 0; c < wide; c++) out[c] += rows[r * wide + c];
    }
}
