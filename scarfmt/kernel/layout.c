/* Where the fields of the structs lie: scarfmt/kernel/layout.py compares them with its own. */

#include "kernel.h"

/* A struct by its name, or a field as struct.field: where it begins, and its bytes. */
typedef struct {
    const char *name;
    int64_t offset, size;
} Place;

#define WHOLE(type) {#type, 0, sizeof(type)}
#define AT(type, field) {#type "." #field, offsetof(type, field), sizeof(((type *)0)->field)}

static const Place PLACES[] = {
    WHOLE(Rans), AT(Rans, state), AT(Rans, left), AT(Rans, words),
    WHOLE(Tables), AT(Tables, kinds), AT(Tables, number), AT(Tables, starts), AT(Tables, sums), AT(Tables, values),
    AT(Tables, few), AT(Tables, used),
    WHOLE(Members), AT(Members, clusters), AT(Members, words), AT(Members, largest), AT(Members, starts),
    AT(Members, places), AT(Members, weights), AT(Members, offsets), AT(Members, shift),
    WHOLE(Cells), AT(Cells, depths), AT(Cells, columns), AT(Cells, cell), AT(Cells, sums), AT(Cells, sizes),
    AT(Cells, means),
    WHOLE(Layer), AT(Layer, rows), AT(Layer, words), AT(Layer, weights), AT(Layer, biases), AT(Layer, shift),
    AT(Layer, low), AT(Layer, high), AT(Layer, unused),
    WHOLE(Predictor), AT(Predictor, rows), AT(Predictor, shared), AT(Predictor, own), AT(Predictor, starts),
    AT(Predictor, weights), AT(Predictor, output), AT(Predictor, shift), AT(Predictor, output_shift),
    AT(Predictor, last),
    WHOLE(Rule), AT(Rule, by_class), AT(Rule, low), AT(Rule, shift), AT(Rule, source), AT(Rule, component),
    AT(Rule, columns),
    WHOLE(Channel), AT(Channel, count), AT(Channel, components), AT(Channel, classes), AT(Channel, values),
    AT(Channel, first), AT(Channel, steps), AT(Channel, rules), AT(Channel, sources), AT(Channel, settled),
    AT(Channel, settled_columns), AT(Channel, settled_stride), AT(Channel, cells), AT(Channel, rows),
    AT(Channel, rows_step), AT(Channel, inputs), AT(Channel, kind), AT(Channel, symbols), AT(Channel, order), AT(Channel, counts), AT(Channel, step),
    AT(Channel, predictors), AT(Channel, tables), AT(Channel, given), AT(Channel, kinds_out),
    AT(Channel, symbols_out),
    WHOLE(ChannelLayer), AT(ChannelLayer, start), AT(ChannelLayer, stop), AT(ChannelLayer, before),
    AT(ChannelLayer, after), AT(ChannelLayer, by_code), AT(ChannelLayer, passes_log2), AT(ChannelLayer, tables),
    AT(ChannelLayer, predictors), AT(ChannelLayer, chosen), AT(ChannelLayer, anchors), AT(ChannelLayer, read),
    AT(ChannelLayer, last), AT(ChannelLayer, at), AT(ChannelLayer, given), AT(ChannelLayer, ends),
    WHOLE(Nodes), AT(Nodes, start), AT(Nodes, count), AT(Nodes, prefix),
    WHOLE(Positions), AT(Positions, total), AT(Positions, bits), AT(Positions, codes), AT(Positions, open),
    AT(Positions, here), AT(Positions, below), AT(Positions, lower), AT(Positions, rest), AT(Positions, counts),
    AT(Positions, symbols), AT(Positions, order), AT(Positions, kind), AT(Positions, static_read),
    AT(Positions, uniform_read),
    WHOLE(WrittenPositions), AT(WrittenPositions, total), AT(WrittenPositions, bits), AT(WrittenPositions, codes),
    AT(WrittenPositions, open), AT(WrittenPositions, here), AT(WrittenPositions, below), AT(WrittenPositions, lower),
    AT(WrittenPositions, rest), AT(WrittenPositions, width), AT(WrittenPositions, sizes),
    AT(WrittenPositions, lengths), AT(WrittenPositions, kinds), AT(WrittenPositions, values),
    AT(WrittenPositions, groups), AT(WrittenPositions, statics), AT(WrittenPositions, symbols),
    WHOLE(GridLevel), AT(GridLevel, dims), AT(GridLevel, axes), AT(GridLevel, resolution), AT(GridLevel, table_log2),
    AT(GridLevel, features), AT(GridLevel, dense), AT(GridLevel, bits),
    WHOLE(Grid), AT(Grid, levels), AT(Grid, origin), AT(Grid, extent_bits), AT(Grid, width), AT(Grid, level),
    WHOLE(Embedding), AT(Embedding, classes), AT(Embedding, own), AT(Embedding, attributes), AT(Embedding, latents),
    AT(Embedding, latent_shift), AT(Embedding, grid), AT(Embedding, amax), AT(Embedding, anchor_class),
    AT(Embedding, settled), AT(Embedding, features),
    WHOLE(Recurrence), AT(Recurrence, tokens), AT(Recurrence, inputs), AT(Recurrence, biases),
    AT(Recurrence, recurrent), AT(Recurrence, shift),
    WHOLE(Head), AT(Head, first), AT(Head, second), AT(Head, top), AT(Head, size), AT(Head, members),
    WHOLE(Network), AT(Network, classes), AT(Network, own), AT(Network, attributes), AT(Network, latents),
    AT(Network, latent_shift), AT(Network, grid), AT(Network, amax), AT(Network, hidden), AT(Network, layers),
    AT(Network, embed), AT(Network, mix_embedding), AT(Network, mix_state), AT(Network, mix_shift),
    AT(Network, mix_start), AT(Network, after_first), AT(Network, sigmoid), AT(Network, tanh), AT(Network, exp2),
    AT(Network, gru), AT(Network, heads), AT(Network, books), AT(Network, sizes),
    WHOLE(Indices), AT(Indices, count), AT(Indices, stages), AT(Indices, classes), AT(Indices, settled),
    AT(Indices, features), AT(Indices, indices), AT(Indices, before), AT(Indices, after), AT(Indices, by_code),
    AT(Indices, passes_log2), AT(Indices, cells), AT(Indices, chosen), AT(Indices, anchors), AT(Indices, means),
    AT(Indices, inputs), AT(Indices, lanes), AT(Indices, shares), AT(Indices, states), AT(Indices, weights), AT(Indices, coded),
    AT(Indices, clusters), AT(Indices, outputs), AT(Indices, counts), AT(Indices, order), AT(Indices, logits),
    AT(Indices, member_weights), AT(Indices, found), AT(Indices, modelled),
    WHOLE(TileChannel), AT(TileChannel, stream), AT(TileChannel, components), AT(TileChannel, attribute),
    AT(TileChannel, residual), AT(TileChannel, rules), AT(TileChannel, widths),
    WHOLE(TileLayer), AT(TileLayer, first_class), AT(TileLayer, past_class), AT(TileLayer, predicted),
    AT(TileLayer, stages), AT(TileLayer, steps), AT(TileLayer, start), AT(TileLayer, stop), AT(TileLayer, tables),
    AT(TileLayer, predictors), AT(TileLayer, positions), AT(TileLayer, classes), AT(TileLayer, indices),
    WHOLE(TileModel), AT(TileModel, channels), AT(TileModel, layers), AT(TileModel, stages),
    AT(TileModel, attributes), AT(TileModel, predicted), AT(TileModel, passes_log2), AT(TileModel, depths),
    AT(TileModel, targets), AT(TileModel, sizes), AT(TileModel, channel), AT(TileModel, layer),
    WHOLE(TileBlock), AT(TileBlock, bytes), AT(TileBlock, length), AT(TileBlock, count),
    WHOLE(Tile), AT(Tile, total), AT(Tile, bits), AT(Tile, blocks), AT(Tile, codes), AT(Tile, classes),
    AT(Tile, values), AT(Tile, first), AT(Tile, indices), AT(Tile, symbols), AT(Tile, received),
    WHOLE(Codewords), AT(Codewords, size), AT(Codewords, dimension), AT(Codewords, words), AT(Codewords, half),
    WHOLE(Frame), AT(Frame, origin), AT(Frame, voxel), AT(Frame, corner), AT(Frame, shift), AT(Frame, widths),
    
    WHOLE(Dense), AT(Dense, inputs), AT(Dense, outputs), AT(Dense, weights), AT(Dense, biases),
    WHOLE(Activation), AT(Activation, count), AT(Activation, coefficients), AT(Activation, latent_width),
    AT(Activation, stages), AT(Activation, layers), AT(Activation, widest), AT(Activation, rotation),
    AT(Activation, opacity), AT(Activation, colour), AT(Activation, latent), AT(Activation, indices),
    AT(Activation, books), AT(Activation, received), AT(Activation, layer),
    AT(Activation, quaternions), AT(Activation, logits), AT(Activation, harmonics),
    {0, 0, 0},
};

/* All of them, ended by one without a name. */
EXPORT const Place *scar_layout(void) { return PLACES; }
