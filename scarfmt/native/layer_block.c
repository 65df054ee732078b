/* LAYER blocks: the channel table and the layer table (SPEC 6.4, 6.5, 7.11, 10.2). */

#include "numbers.h"

#include <string.h>

#define WIDEST 0x1p96

int64_t is_attribute(int64_t stream) {
    return stream == SCALE || stream == ROTATION || stream == OPACITY || stream == COLOUR;
}

int64_t channel_of(const Model *m, int64_t stream) {
    for (int64_t c = 0; c < m->channels; c++)
        if (m->channel[c].stream == stream) return c;
    return -1;
}

/* Components of a stream kind, 0 where LATENT has any number; -1: not of the profile. */
static int64_t components_of(int64_t profile, int64_t stream) {
    if (stream == POSITION_RESIDUAL) return 3;
    if (stream == LATENT) return 0;
    if (stream == SCALE) return profile == ANCHOR ? 6 : 3;
    if (profile == ANCHOR) return stream == OFFSETS ? 3 : -1;
    return stream == ROTATION || stream == COLOUR ? 3 : stream == OPACITY ? 1 : -1;
}

/* The models of fields that a block has more than once. */
typedef struct {
    Numbers numbers;
    NumberModel stream, components, first_widths, targets, stages, steps;
} LayerReader;

static int64_t read_field(LayerReader *reader, NumberModel *model) {
    return read_limited(&reader->numbers, model, INT64_MAX);
}

static void read_channel_fields(LayerReader *reader, ChannelModel *out) {
    uint32_t bits = 0;
    out->stream = read_field(reader, &reader->stream);
    demand(out->stream >= POSITION_RESIDUAL && out->stream <= OFFSETS && out->stream != INDICES, "bad-channel");
    out->components = read_field(reader, &reader->components);
    demand(out->components >= 1 && out->components <= MOST_COMPONENTS, "bad-channel");
    spend(&reader->numbers, out->components);
    for (int64_t c = 0; c < out->components; c++) {
        bits ^= next_number(&reader->numbers, &reader->first_widths);
        out->first_width[c] = float_of(bits);
    }
}

void read_layer_block(Model *m, int64_t k) {
    const Body block = m->blocks[k][LAYER_BLOCK];
    demand(block.bytes != NULL, "missing-block");
    LayerReader reader = {open_numbers(m, block)};
    Numbers *numbers = &reader.numbers;
    Row *row = m->rows + k;
    memset(row, 0, sizeof *row);
    row->mode = read_once(numbers, INT64_MAX);
    demand(row->mode <= 1, "unsupported-entropy-mode");
    if (k == 1) {
        m->channels = read_once(numbers, MOST_CHANNELS);
        for (int64_t c = 0; c < m->channels; c++) read_channel_fields(&reader, m->channel + c);
        m->passes_log2 = read_once(numbers, INT64_MAX);
        m->depths = read_once(numbers, MOST_DEPTHS);
        spend(numbers, m->depths);
        for (int64_t d = 0; d < m->depths; d++) m->targets[d] = next_number(numbers, &reader.targets);
    }
    row->classes = read_once(numbers, MOST_CLASSES);
    for (int64_t c = 0; c < row->classes; c++) {
        row->stages[c] = read_field(&reader, &reader.stages);
        spend(numbers, m->channels);
        for (int64_t i = 0; i < m->channels; i++) row->steps[i][c] = next_number(numbers, &reader.steps);
    }
    seal_numbers(numbers);
}

/* R-6.4-1 to R-6.4-3, then R-10.2-1. */
void check_channels(Model *m) {
    for (int64_t i = 0; i < m->channels; i++) {
        const ChannelModel *channel = m->channel + i;
        const int64_t wanted = components_of(m->profile, channel->stream);
        demand(!i || channel[-1].stream < channel->stream, "bad-channel");
        demand(wanted >= 0 && (!wanted || wanted == channel->components), "bad-channel");
        for (int64_t c = 0; c < channel->components; c++)
            demand(channel->first_width[c] > 0 && channel->first_width[c] <= WIDEST, "bad-channel");
    }
    demand(channel_of(m, SCALE) >= 0 && (m->profile == EXPLICIT || channel_of(m, OFFSETS) >= 0), "bad-channel");
    demand(m->passes_log2 <= 3, "bad-context");
    for (int64_t d = 0; d < m->depths; d++)
        demand(m->targets[d] >= 1 && m->targets[d] < (d ? m->targets[d - 1] : 1 << 16), "bad-context");
}

/* Whether numbers of classes do not fall from `old` on, and are at most `most`. */
static int keeps(const int64_t *now, const int64_t *old, int64_t most) {
    for (int64_t c = 0; c < MOST_CLASSES; c++)
        if (now[c] < old[c] || now[c] > most) return 0;
    return 1;
}

int64_t needs_decoder(const Model *m, const Row *row) {
    const int64_t latent = channel_of(m, LATENT);
    for (int64_t c = 0; c < row->classes; c++)
        if (row->stages[c] || (latent >= 0 && row->steps[latent][c])) return 1;
    return 0;
}

static int has_stages(const Row *row) {
    for (int64_t c = 0; c < row->classes; c++)
        if (row->stages[c]) return 1;
    return 0;
}

/* R-6.5-2 and R-10.4-1 layer by layer, R-6.5-3, R-6.5-4. */
void check_layer_rows(const Model *m, int64_t from, int64_t to) {
    const int64_t offsets = channel_of(m, OFFSETS);
    for (int64_t k = from; k <= to; k++) {
        const Row *row = m->rows + k, *before = row - 1;
        demand(row->classes >= 1 && row->classes >= before->classes, "bad-layer-table");
        demand(keeps(row->stages, before->stages, MOST_STAGES), "bad-layer-table");
        for (int64_t i = 0; i < m->channels; i++)
            demand(keeps(row->steps[i], before->steps[i], MOST_STEPS), "bad-layer-table");
        demand(!row->mode || has_stages(row), "bad-layer-table");
    }
    for (int64_t k = from; offsets >= 0 && k <= to; k++)
        for (int64_t c = 0; c < m->rows[k].classes; c++)
            demand(m->rows[k].steps[offsets][c] == 1, "bad-layer-table");
    demand(m->profile == EXPLICIT || needs_decoder(m, m->rows + 1), "bad-layer-table");
}

/* Widths of cells after each number of steps (SPEC 9). */
static double *width_table(Model *m, const ChannelModel *channel) {
    double *widths = pool_zeros(&m->pool, 8 * (MOST_STEPS + 1) * channel->components), power = 1;
    for (int64_t n = 1; n <= MOST_STEPS; n++, power *= 3)
        for (int64_t c = 0; c < channel->components; c++)
            widths[n * channel->components + c] = channel->first_width[c] / power;
    return widths;
}

/* What follows from a channel table that was checked. */
void finish_channels(Model *m) {
    m->attributes = 0;
    for (int64_t i = 0; i < m->channels; i++) {
        ChannelModel *channel = m->channel + i;
        if (is_attribute(channel->stream)) m->attributes += channel->components;
        channel->widths = width_table(m, channel);
    }
}
