"""Structures that the compiled library shares with Python, as kernel.h and its neighbours declare them."""

from __future__ import annotations

from ctypes import POINTER, Structure, c_double, c_int32, c_int64, c_uint64, c_void_p

DEPTHS, HEADS, GRU_LAYERS = 4, 2, 4
CHANNELS, STAGES, STEPS, CLASS_ROOM, STREAM_KINDS = 8, 8, 20, 16, 12


class Rans(Structure):
    """State of a rANS decoder."""

    _fields_ = (("state", c_uint64), ("left", c_uint64), ("words", c_void_p))


class Tables(Structure):
    """Static tables by kind."""

    _fields_ = (
        ("kinds", c_int64),
        ("number", c_void_p),
        ("starts", c_void_p),
        ("sums", c_void_p),
        ("values", c_void_p),
        ("few", c_void_p),
        ("used", c_void_p),
    )


class Members(Structure):
    """Codewords of the clusters of a two-level head."""

    _fields_ = (
        *((name, c_int64) for name in ("clusters", "words", "largest")),
        *((name, c_void_p) for name in ("starts", "places", "weights", "offsets")),
        ("shift", c_int64),
    )


class Cells(Structure):
    """Sums over the anchors of each cell."""

    _fields_ = (
        ("depths", c_int64),
        ("columns", c_int64),
        ("cell", c_void_p * DEPTHS),
        ("sums", c_void_p * DEPTHS),
        ("sizes", c_int64 * DEPTHS),
        ("means", c_void_p * DEPTHS),
    )


class Layer(Structure):
    """One linear layer in integers."""

    _fields_ = (
        *((name, c_int64) for name in ("rows", "words")),
        *((name, c_void_p) for name in ("weights", "biases")),
        *((name, c_int32) for name in ("shift", "low", "high", "unused")),
    )


class Predictor(Structure):
    """One component's predictor."""

    _fields_ = (
        *((name, c_int64) for name in ("rows", "shared", "own")),
        *((name, c_void_p) for name in ("starts", "weights", "output")),
        *((name, c_int32) for name in ("shift", "output_shift")),
        ("last", c_int32 * 2),
    )


class Rule(Structure):
    """One component's static context."""

    _fields_ = tuple((name, c_int64) for name in ("by_class", "low", "shift", "source", "component", "columns"))


class Channel(Structure):
    """One channel in one tile-layer."""

    _fields_ = (
        ("count", c_int64),
        ("components", c_int64),
        *((name, c_void_p) for name in ("classes", "values", "first", "steps", "rules", "sources", "settled")),
        ("settled_columns", c_int64),
        ("settled_stride", c_int64),
        ("cells", Cells),
        ("rows", c_void_p),
        ("rows_step", c_int64),
        *((name, c_void_p) for name in ("inputs", "kind", "symbols", "order", "counts")),
        ("step", c_int64),
        *((name, c_void_p) for name in ("predictors", "tables", "given", "kinds_out", "symbols_out")),
    )


class ChannelLayer(Structure):
    """The part of a channel that a layer brings."""

    _fields_ = (
        ("start", c_int64),
        ("stop", c_int64),
        *((name, c_void_p) for name in ("before", "after", "by_code")),
        ("passes_log2", c_int64),
        *((name, c_void_p) for name in ("tables", "predictors", "chosen", "anchors", "read")),
        *((name, c_void_p) for name in ("last", "at", "given", "ends")),
    )


class Nodes(Structure):
    """Nodes of one level of the tree of positions."""

    _fields_ = (("start", c_void_p), ("count", c_void_p), ("prefix", c_void_p))


class Positions(Structure):
    """The positions of one tile-layer."""

    _fields_ = (
        ("total", c_int64),
        ("bits", c_int64),
        ("codes", c_void_p),
        ("open", c_void_p),
        ("here", Nodes),
        ("below", Nodes),
        *((name, c_void_p) for name in ("lower", "rest", "counts", "symbols", "order", "kind")),
        ("static_read", c_int64),
        ("uniform_read", c_int64),
    )


class WrittenPositions(Structure):
    """The positions of one tile-layer as they are written."""

    _fields_ = (
        ("total", c_int64),
        ("bits", c_int64),
        ("codes", c_void_p),
        ("open", c_void_p),
        ("here", Nodes),
        ("below", Nodes),
        *((name, c_void_p) for name in ("lower", "rest", "width", "sizes", "lengths", "kinds", "values")),
        *((name, c_int64) for name in ("groups", "statics", "symbols")),
    )


class GridLevel(Structure):
    """One level of a hash grid."""

    _fields_ = (
        ("dims", c_int64),
        ("axes", c_int64 * 3),
        *((name, c_int64) for name in ("resolution", "table_log2", "features", "dense")),
        ("bits", c_void_p),
    )


class Grid(Structure):
    """A hash grid."""

    _fields_ = (
        ("levels", c_int64),
        ("origin", c_int64 * 3),
        ("extent_bits", c_int64),
        ("width", c_int64),
        ("level", POINTER(GridLevel)),
    )


class Embedding(Structure):
    """The inputs of the embedding of the index network."""

    _fields_ = (
        *((name, c_int64) for name in ("classes", "own", "attributes", "latents", "latent_shift", "grid", "amax")),
        *((name, c_void_p) for name in ("anchor_class", "settled", "features")),
    )


class Recurrence(Structure):
    """One recurrent layer of the index network."""

    _fields_ = (
        ("tokens", c_void_p * HEADS),
        ("inputs", Layer),
        ("biases", c_void_p),
        ("recurrent", Layer),
        ("shift", c_int64),
    )


class Head(Structure):
    """The head of one codebook."""

    _fields_ = (
        ("first", Layer),
        ("second", Layer),
        ("top", Layer),
        ("size", c_int64),
        ("members", POINTER(Members)),
    )


class Network(Structure):
    """The index network, without attention."""

    _fields_ = (
        *((name, c_int64) for name in ("classes", "own", "attributes", "latents", "latent_shift", "grid")),
        *((name, c_int64) for name in ("amax", "hidden", "layers")),
        ("embed", Layer * 2),
        ("mix_embedding", Layer),
        ("mix_state", Layer),
        ("mix_shift", c_int64),
        *((name, c_void_p) for name in ("mix_start", "after_first", "sigmoid", "tanh", "exp2")),
        ("gru", Recurrence * GRU_LAYERS),
        ("heads", Head * HEADS),
        ("books", c_void_p * HEADS),
        ("sizes", c_int64 * HEADS),
    )


class Indices(Structure):
    """The indices of one tile-layer."""

    _fields_ = (
        ("count", c_int64),
        ("stages", c_int64),
        *((name, c_void_p) for name in ("classes", "settled", "features", "indices", "before", "after", "by_code")),
        ("passes_log2", c_int64),
        ("cells", Cells),
        *(
            (name, c_void_p)
            for name in ("chosen", "anchors", "means", "inputs", "lanes", "shares", "states", "weights")
        ),
        *((name, c_void_p) for name in ("coded", "clusters", "outputs", "counts", "order", "logits")),
        *((name, c_void_p) for name in ("member_weights", "found")),
        ("modelled", c_int64),
    )


class TileChannel(Structure):
    """A channel of a file, as tiles are read."""

    _fields_ = (
        *((name, c_int64) for name in ("stream", "components", "attribute", "residual")),
        ("rules", c_void_p),
        ("widths", c_void_p),
    )


class TileLayer(Structure):
    """The content of a tile in a layer, with the tables and predictors in force."""

    _fields_ = (
        *((name, c_int64) for name in ("first_class", "past_class", "predicted")),
        ("stages", c_int64 * CLASS_ROOM),
        ("steps", c_int64 * CLASS_ROOM * CHANNELS),
        ("start", c_int64 * CHANNELS),
        ("stop", c_int64 * CHANNELS),
        ("tables", c_void_p * CHANNELS),
        ("predictors", c_void_p * CHANNELS),
        ("positions", c_void_p),
        ("classes", c_void_p),
        ("indices", c_void_p * STAGES),
    )


class TileModel(Structure):
    """A file of the explicit profile, up to some layer, without an index network."""

    _fields_ = (
        *((name, c_int64) for name in ("channels", "layers", "stages", "attributes", "predicted", "passes_log2")),
        ("depths", c_int64),
        ("targets", c_int64 * DEPTHS),
        ("sizes", c_int64 * HEADS),
        ("channel", TileChannel * CHANNELS),
        ("layer", POINTER(TileLayer)),
    )


class TileBlock(Structure):
    """The block of one layer of a tile."""

    _fields_ = (("bytes", c_void_p), ("length", c_int64), ("count", c_int64))


class Tile(Structure):
    """One tile: what it is read from and where to."""

    _fields_ = (
        ("total", c_int64),
        ("bits", c_int64),
        ("blocks", POINTER(TileBlock)),
        ("codes", c_void_p),
        ("classes", c_void_p),
        ("values", c_void_p * CHANNELS),
        ("first", c_void_p * CHANNELS),
        *((name, c_void_p) for name in ("indices", "symbols", "received")),
    )


class Codewords(Structure):
    """A codebook to search."""

    _fields_ = (("size", c_int64), ("dimension", c_int64), ("words", c_void_p), ("half", c_void_p))


class Frame(Structure):
    """The place of the codes of a tile in the world."""

    _fields_ = (
        ("origin", c_double * 3),
        ("voxel", c_double),
        ("corner", c_double * 3),
        ("shift", c_int64),
        ("widths", c_void_p),
    )


class Dense(Structure):
    """One layer of a latent decoder."""

    _fields_ = (("inputs", c_int64), ("outputs", c_int64), ("weights", c_void_p), ("biases", c_void_p))


class Activation(Structure):
    """Exact values of anchors, and the Gaussians made of them."""

    _fields_ = (
        *((name, c_int64) for name in ("count", "coefficients", "latent_width", "stages", "layers", "widest")),
        *((name, c_void_p) for name in ("rotation", "opacity", "colour", "latent", "indices", "received")),
        ("books", c_void_p * HEADS),
        ("layer", Dense * GRU_LAYERS),
        *((name, c_void_p) for name in ("quaternions", "logits", "harmonics")),
    )
