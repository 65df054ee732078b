/* From integers to Gaussians, for display (SPEC 9.3, 9.4). */

#include "gaussians.h"

#include <string.h>

const float *values_of(const Model *m, const TileState *t, int64_t stream, Pool *pool) {
    const int64_t channel = channel_of(m, stream);
    return channel < 0 ? NULL : exact_values(m, t, channel, pool);
}

static void put_scales(const float *values, int64_t n, float *out) {
    for (int64_t i = 0; i < n; i += 4) store4(out + i, exp4(load4(values + i)));
}

/* opacity = e^y, since its logit is y - ln(1 - e^y). */
static void put_opacity(const float *values, int64_t n, float *out) {
    for (int64_t i = 0; i < n; i += 4)
        store4(out + i, exp4(least4(values ? load4(values + i) : all4(0), all4(MOST_LOG_OPACITY))));
}

/* Column `c` of four rows of three. */
INLINE Float4 column_of(const float *rows, int c) { return (Float4){rows[c], rows[3 + c], rows[6 + c], rows[9 + c]}; }

static void sines(Float4 angle, Float4 *sine, Float4 *cosine) {
    const Float4 size = abs4(angle);
    Int4 quarters = {0};
    int far = 0;
    for (int j = 0; j < FLOATS; j++) far |= size[j] > PLAIN_ANGLE;
    if (!far) {
        sincos4(angle, sine, cosine);
        return;
    }
    for (int j = 0; j < FLOATS; j++) {
        int32_t turns = 0;
        angle[j] = angle[j] == 0 ? 0 : reduced_angle(angle[j], &turns);
        quarters[j] = turns;
    }
    turn4(quarters, angle, sine, cosine);
}

/* Unit quaternions of four normals on the square and twists (SPEC 9.3). */
static void put_quaternions(const float *rows, float *out) {
    Float4 sine, cosine;
    const Float4 u = column_of(rows, 0), v = column_of(rows, 1);
    sines(column_of(rows, 2) * .5f, &sine, &cosine);
    const Float4 largest = least4(most4(most4(abs4(u), abs4(v)), all4(1)), all4(0x1p126f));
    /* A power of two by which nothing overflows. */
    const Float4 one = (Float4)((254 << 23) - ((Int4)largest & 0x7f800000));
    const Float4 px = (u * one + v * one) * .5f, py = (u * one - v * one) * .5f, pz = one - abs4(px) - abs4(py);
    const Float4 length = root4(px * px + py * py + pz * pz);
    const Float4 x = px / length, y = py / length, w = 1 + pz / length;
    const Float4 whole = root4(w * w + x * x + y * y), by = choose4(cosine < 0, -1 / whole, 1 / whole);
    const Float4 q[4] = {w * cosine * by, (x * sine - y * cosine) * by, (x * cosine + y * sine) * by, w * sine * by};
    for (int j = 0; j < FLOATS; j++)
        for (int c = 0; c < 4; c++) out[4 * j + c] = q[c][j];
}

WIDE void put_rotations(const float *values, int64_t n, float *out) {
    const float none[3 * FLOATS] = {0};
    const int64_t whole = n / FLOATS * FLOATS;
    for (int64_t i = 0; i < whole; i += FLOATS) put_quaternions(values ? values + 3 * i : none, out + 4 * i);
    if (whole == n) return;
    float last[4 * FLOATS];
    put_quaternions(values ? values + 3 * whole : none, last);
    memcpy(out + 4 * whole, last, 16 * (size_t)(n - whole));
}

static void put_colours(const float *colours, int64_t n, int64_t row, float *out) {
    for (int64_t i = 0; i < n; i++, colours += 3, out += row) {
        out[0] = colours[0] - colours[1] + colours[2];
        out[1] = colours[0] + colours[1];
        out[2] = colours[0] - colours[1] - colours[2];
    }
}

/* What DECODER_MLP makes of the latents, behind the first `skipped` numbers of each row. */
static void put_decoded(const Model *m, const TileState *t, int64_t skipped, int64_t row, Pool *pool, float *out) {
    const Mlp *decoder = &m->decoder;
    const MlpLayer *last = decoder->layer + decoder->layers - 1;
    const int64_t dims = decoder->layer[0].columns, n = t->known;
    const float *latents = exact_latents(m, t, pool);
    float *room = pool_take(pool, 8 * FLOATS * mlp_width(decoder)), *four = pool_zeros(pool, 4 * FLOATS * dims);
    for (int64_t i = 0; i < n; i += FLOATS) {
        const int64_t some = n - i < FLOATS ? n - i : FLOATS;
        const float *x = latents + i * dims;
        if (some < FLOATS) memcpy(four, x, 4 * (size_t)(some * dims)), x = four;
        const float *y = apply_mlp(decoder, x, dims, room);
        for (int64_t j = 0; j < some; j++)
            memcpy(out + (i + j) * row + skipped, y + j * last->stride, 4 * (size_t)last->rows);
    }
}

void put_harmonics(const Model *m, const TileState *t, Pool *pool, float *out) {
    const int64_t n = t->known, row = 3 * (m->sh_degree + 1) * (m->sh_degree + 1);
    const float *colours = values_of(m, t, COLOUR, pool);
    if (!has_decoder(m, t)) memset(out, 0, 4 * (size_t)(n * row));
    if (colours) put_colours(colours, n, row, out);
    if (has_decoder(m, t)) put_decoded(m, t, colours ? 3 : 0, row, pool, out);
}

void activate(const Model *m, const TileState *t, Pool *pool, Gaussians *out) {
    const int64_t n = t->known, filled = fours(n), coefficients = (m->sh_degree + 1) * (m->sh_degree + 1);
    const double *positions = exact_positions(m, t, pool);
    out->count = (int32_t)n, out->coefficients = (int32_t)coefficients;
    out->centres = pool_take(pool, 12 * n), out->scales = pool_take(pool, 12 * filled);
    out->quaternions = pool_take(pool, 16 * n), out->opacity = pool_take(pool, 4 * filled);
    out->harmonics = pool_take(pool, 12 * n * coefficients), out->features = NULL;
    for (int64_t i = 0; i < 3 * n; i++) out->centres[i] = (float)positions[i];
    put_scales(values_of(m, t, SCALE, pool), 3 * n, out->scales);
    put_rotations(values_of(m, t, ROTATION, pool), n, out->quaternions);
    put_opacity(values_of(m, t, OPACITY, pool), n, out->opacity);
    put_harmonics(m, t, pool, out->harmonics);
}
