"""Every number of the encoder that was measured or chosen, in one place, with its unit and the decision that has it.

Numbers in brackets are decision records (docs/decisions). A change of any of them changes files, never the format.
Sizes of chunks, mathematical constants and bounds of the format stay with the code that needs them; what an effort
level switches on is `reference_encoder.options.EFFORTS`.
"""

from __future__ import annotations

from scarfmt.container.schema import Stream
from scarfmt.scene.model import DecodedContext

# --- What an error shows: importance/ ---

BLUR_PX2 = 0.4
"""Pixels^2: the rasteriser's 0.3 px dilation and the pixel itself blur every splat; below this variance an axis hardly
shows its own length [0003]."""
HIDDEN_SCALE = 0.1
"""Share of that blur's deviation below which an axis says nothing: it adds a hundredth to a variance [0028]."""
SCALE_SHARE = (1.0, 0.8, 0.25)
"""Share of the longest, middle and shortest axis in the picture error of a log-scale error [0003]."""
ASPECT_CAP = 9.0
"""A needle seen from its side reacts to rotation like the square of its aspect ratio, up to about a radian; beyond this
ratio of variances the linear model overestimates [0003]."""
OPACITY_SHARE = 1.1
"""Picture error of a squared error of log opacity, in that of a relative change of the splat [0003]."""
GAUSSIAN_ABSENCE = 10.0
"""Leaving a Gaussian out is so many times worse than the sum of single errors says: neighbours left out err together
[0003, 0023]."""
SLOT_ABSENCE = 8.0
"""Factor by which leaving out a slot of an anchor is worse than changing it [0003]."""
SIZE_SHARE = 0.7
"""Picture error of a squared error of the log sizes of an anchor's slots, in that of their shape [0003]."""
METRIC_ANCHORS = 1500
"""Anchors, drawn by visibility, whose Jacobians say which feature errors matter [0003]."""
SURVEY_POWER = 2.0
"""Power of the mean over views: 1 is the plain mean, more leans to the views that show a Gaussian most [0023]."""
SURVEY_SEED = 2023
"""Seed of the survey's views; judging views have other seeds [0023]."""
SURVEY_SAMPLES = 19_200
"""Pixels looked at of each view: 160 x 120 of 640 x 480 [0023]."""
ORBIT_PART, LOCAL_GAUSSIANS, MOST_LOCAL_VIEWS = 1 / 6, 600_000, 768
"""Part of the views that look from outside; the others see a part of a scene, and grow in number with what is beyond so
many Gaussians, up to so many views [0023]."""
ANCHOR_VIEWS = 48
"""Views of anchor models at most, given ones apart: their networks are run for each [0023]."""
KIND_SHARES = {"orbit": 1 / 2, "near": 1 / 4, "inside": 1 / 4}
"""How much each kind of view counts [0023]."""
GIVEN_SHARE, BESIDE_SHARE = 0.5, 0.2
"""How much given cameras count, and views beside them; the rest is for everywhere [0023]."""
JITTER_PART, JITTER_DEG = 0.1, 10.0
"""How far beside: eyes up to this part of the scene's radius, directions up to so many degrees [0023]."""
FLOOR_SHARE, FLOOR_GAUSSIANS = 0.005, 4_000_000
"""Every Gaussian weighs at least this share of what it would with nothing in front of it, in a scene of so many; in
smaller ones, which the survey knows better, a share in proportion [0023]."""
FLOOR_DISTANCE, FLOOR_CONTRAST = 0.1, 0.3
"""How far away that is, radii, and how it contrasts with what is behind it [0023]."""
DRAFT_GAUSSIANS = 1_100_000
"""Without a survey every Gaussian weighs what the floor is in a scene of so many: then quality is about what is asked
[0057]."""
INVISIBLE_WEIGHT = 1 / 255
"""Maximum weight, in any pixel of the survey, of a Gaussian that counts as invisible [0023]."""

# --- Reaching the quality asked for: judge/ ---

TOLERANCE_DB, SURE_DB = 0.4, 3.0
"""Close enough, dB: as many views from elsewhere differ by as much; and the longest step after which nobody looks again
[0025, 0057]."""
TUNING_SEED, HELD_OUT_SEED = 2025, 2027
"""Seeds of the views by which results are corrected, and of those by which they are reported [0025]."""
JUDGED_SAMPLES = 4800
"""Pixels looked at of each of these views: 80 x 60 of 640 x 480 [0025]."""
LEAST_JUDGED_VIEWS = 12
"""Least number of judging views of each kind, whatever the size of the scene [0025, 0057]."""
LOW_VIEWS = 3
"""How many times more views a 5th percentile takes than a mean [0057]."""
CLOSE_PART, CLOSE_DEG = 0.02, 2.0
"""How far beside given cameras views are that stand for them: eyes by this part of the scene's radius, directions by so
many degrees [0025]."""
JUDGED_SHARES = {"orbit": 0.3, "near": 0.2, "inside": 0.5}
"""How much each kind of judging view counts: as many places lie within a scene as without [0058]."""
LIT, LIT_SHARE = 2 / 255, 0.05
"""A judging view counts if this share of its pixels has a channel brighter than that: pictures of next to nothing are
right whatever a file holds [0058]."""
MOST_ABOVE_DB = 15.0
"""How far above the target one picture counts at most, dB [0025, 0058]."""
MEAN_ABOVE_DB = 1.5
"""How far above the target the mean may go for the sake of the 5th percentile, dB [0058]."""
WORST_BELOW_DB = 8.0
"""About how far the 5th percentile lies below the mean: where the search for a floor begins [0025]."""
KIND_BELOW_DB, LOW_BELOW_DB = 3.0, 6.0
"""How far the mean of a kind may lie below what was asked before it is said; and how far the 5th percentile may before
lambda is lowered for it [0025, 0058]."""
GROWTH_A_DB = 0.07
"""About how much larger a file is that is a dB better: a share of its bytes [0058]."""
FIRST_SLOPE, LEAST_SLOPE, GREATEST_SLOPE = 1.1, 0.5, 2.0
"""dB found per dB aimed at: as a rule, at least and at most [0017, 0057]."""
MOST_UP_DB, MOST_DOWN_DB = 6.0, 15.0
"""dB between an aim and the first one: an error that no lambda takes away, such as clamped values, must not buy bits
without end [0017]."""

# --- Lambda: rdo/curves.py ---

LAMBDA_QUALITY_DB, LAMBDA_SLOPE = 42.0, 0.82
"""A quality, and dB found per dB of lambda [0004]."""
GAUSSIAN_LAMBDA_DB, ANCHOR_LAMBDA_DB = 45.3, 60.0
"""At that quality, lambda times the number of Gaussians, or of anchors, is so many dB below 1. Weights of Gaussians are
power means, those of anchors plain ones [0004, 0023, 0057]."""

# --- Classes and what they receive: rdo/ ---

IMPORTANCE_RATIO = 9.0
"""Squared-error ratio between neighbouring classes: one ternary step [0007]."""
CLASS_COLOUR_SHARE = 0.5
"""Share of the colour in the importance that makes classes of Gaussians with view-dependent colour; without, shape
alone makes them [0027]."""
MOST_GAUSSIAN_CLASSES, MOST_ANCHOR_CLASSES = 8, 7
"""Classes of a file, explicit and anchor profile [0007]."""
GAUSSIAN_BITS, ANCHOR_BITS = 40.0, 60.0
"""Bits of the cheapest Gaussian or anchor: a position, a class and first steps [0007]."""
SLOT_BITS = 14.0
"""Bits that turning a slot of an anchor on costs: its place in the mask and an offset [0007]."""
POSITION_BITS = 10.0
"""Bits of a base position and its label: about what the split coder spends on a dense surface [0002]."""
FINEST_STEP = 9
"""Ternary steps looked at: beyond these nothing ever paid (3^8 = 6561 cells across the first one) [0004]."""
TABLE_ENTRY_BITS = 8.0
"""Bits of an entry of a static table [0001]."""
PLANNED_ANCHORS = 12_000
"""Anchors of a class that stand for all of it when steps are priced [0014]."""
COARSEST_COLOUR = 0.42
"""No layer has wider cells of colour, in coefficients of degree 0: neighbours that all round to grey make a grey meadow
[0026]."""
STAGGER = 3.0**0.5
"""Factor of lambda, up or down, by which channels and classes refine in different layers [0007]."""
ROUNDING_ROUNDS = 2
"""How often prices and choices of rounded values are made to agree [0004]."""
REST_SHARE = 2.6
"""Errors of view-dependent colour agree between neighbours more than others do: so much more they count [0003,
0051]."""
SHAPE_SHARE = {Stream.SCALE: 1.5, Stream.ROTATION: 1.5}
"""Factors of errors of shape, which agree between neighbours more than other errors do [0003]."""
GAUSSIAN_COARSEST: dict[Stream, tuple[float, ...]] = {
    Stream.POSITION_RESIDUAL: (1 / 3, 1 / 3, 1 / 3),
    Stream.SCALE: (0.55, 0.6, 1.0),
    Stream.ROTATION: (0.6, 0.6, 0.9),
    Stream.OPACITY: (1.0,),
    Stream.COLOUR: (1.5, 1.5, 1.8),
}
"""Coarsest useful first cell of each component, in the units of SPEC §9 [0003]."""
ANCHOR_COARSEST: dict[Stream, tuple[float, ...]] = {Stream.POSITION_RESIDUAL: (1 / 3,) * 3, Stream.SCALE: (0.9,) * 6}
"""Coarsest useful first cell of each component in the anchor profile [0003]."""
COARSEST_LATENT = 81.0
"""Coarsest step of each component of the latent channel, in lattice units [0005]."""
MLP_BITS = 10
"""Bits of a weight of an anchor model's networks [0003]."""

# --- Tiles: rdo/lattice.py ---

TILE_ANCHORS, LARGE_SCENE_TILE_ANCHORS = 32768, 16384
"""Most anchors of a tile unless asked otherwise; the second in scenes of more than `LARGE_SCENE` anchors.

Only there a region is a small part of a file [0015]."""
LARGE_SCENE = 1 << 18
"""Anchors [0015]."""
CELL_FACTOR, CELL_PERCENTILE = 1.5, 70
"""A leaf cell is this many times the step that pays for this percentile of a tile's anchors; those who need more get it
from the position residual [0002]."""

# --- Layers: rdo/layers.py ---

GAUSSIAN_BASE_SHARE, ANCHOR_BASE_SHARE = 0.265, 0.28
"""Share of the bits that the first layer may take. An anchor model's networks travel in it besides [0007]."""
COARSE_ABSENCE = 3.0
"""How much worse than predicted leaving out a whole class is in early layers: holes, where one Gaussian leaves none
[0007]."""
FIRST_VIEWS, LATER_VIEWS = 12, 4
"""Least number of judging views of each kind that decide what the first layer holds, and what others do: these are
compared with each other, the first with a figure [0062, 0064]."""
PREVIEW_LOW_PART, PREVIEW_LOW_BELOW_DB = 0.2, 2.5
"""The part of these views that looks worst, and how far below the mean the best of it may lie before it decides, dB.
The 20th percentile of three dozen views says more of the 5th of other ones than their own does [0062]."""
FIRST_CAP_DB = 35.0
"""A view of next to nothing does not make up for another: at least as good a view counts as much [0026]."""
PICTURE_DB = 25.4
"""A first picture, dB over all kinds of views: one recognises everything, nobody takes it for the last [0018,
0062]."""
NEIGHBOURS = 8
"""Number of neighbours of a class among which those that cover most are shown before the others [0026]."""
FRONT_CLASSES, FRONT_STEP = 3.0, 0.125
"""Over so many classes the part that a first layer shows falls from all to nothing, and in which steps that is tried,
classes [0026]."""
FRONT_LAMBDA, MOST_MODEL_SHARE = 100.0, 0.25
"""Lambda of a first layer chosen without pictures, in lambdas of the last layer; and maximum share of models in it
[0026]."""
FEWEST_DIVIDED = 64
"""Anchors of a class that may be shown in part [0026]."""
WORTH_DB = 1.0
"""A layer in between that gains fewer dB, or leaves fewer to the last, is left out [0018, 0026]."""
BELOW_DB = 8.0
"""dB that the first picture is at least worse than the last layer [0018]."""
LARGEST_SHARE = 0.4
"""Maximum share of the bits in a first layer: with more it is no preview [0018]."""
LARGEST_LAMBDA_RATIO, LAMBDAS = 1e7, 80
"""Lambdas a layer may have: the largest over that of the last layer, and how many [0018]."""
USUAL_DB, COARSER_LAMBDAS = 27.0, 15
"""A first layer has about the lambda of a file of so many dB; how many larger ones are tried [0060]."""
FRONT_STRIDE = 4
"""Beyond the least part of the scene that is good enough, and where none is, every fourth one is looked at [0060]."""

# --- Latents: rdo/latent.py, and codewords of training ---

MAX_DIMENSIONS = 48
"""Maximum dimensions of a linear latent [0005]."""
LATENT_RANGE = 120.0
"""Lattice units that 99.9 % of the latents' coordinates stay within: fine against what the most visible anchors can
show [0005]."""
DECODER_BITS = 12
"""Bits of a weight of the latent decoder [0005]."""
DECODER_WEIGHT_BITS = 12.0
"""About what a weight of the decoder takes in a file [0005]."""
RVQ_PRIOR_USES = 0.02
"""A code that nobody uses is not free: this many virtual uses keep its price finite [0005]."""
LEARNED_DECAY = 0.99
"""Share of its moving sums that a codeword of an autoencoder keeps from step to step [0005]."""
LEARNED_STALE_SHARE = 0.1
"""A code with less than this share of the mean use is stale and restarts at a vector of the batch [0005]."""
KMEANS_ROUNDS = 8
"""Rounds of k-means at the start of learned codebooks [0005]."""
METRIC_VECTORS = 8192
"""Vectors over which a learned decoder is made an isometry on average [0005]."""
LEAST_GAIN = 1e-9
"""Directions a learned decoder hardly reacts to hold nothing: their least share of the largest gain [0005]."""
FINEST_UNIT = 1e-5
"""Finer lattices than this share of the vectors' own size only store noise [0005]."""
# --- Networks: training/networks/ ---

CONTEXT = DecodedContext(passes_log2=2, occupancies=(32, 4))
"""Passes of a group, and anchors of a cell at either depth: finer contexts save a little more and cost a decoder more
runs [0009]."""
CONTEXT_LATENTS = 16
"""Latent dimensions whose cell means are inputs of the index network [0010]."""
NARROWEST_HIDDEN, WIDEST_HIDDEN, INDICES_OF_EIGHT = 6, 64, 75_000
"""Width of the index network: it grows with the square root of the number of indices, 8 for so many [0010]."""
CODEWORD_DIMS = 24
"""Latent dimensions of a codeword that the index network sees at most [0010]."""
FINE_WEIGHTS_FROM = 20
"""Networks of at least this width get a fifth bit of weight [0010]."""
SMALLEST_BATCH, LARGEST_BATCH = 64, 1024
"""Rows of a step [0010]."""
INDEX_LEARNING_RATE, LAST_INDEX_LEARNING_RATE = 0.018, 0.01
"""Learning rates of the index network: along with the scene, and after it [0010, 0011]."""
INDEX_ROWS, INDEX_VISITS, MOST_INDEX_EPOCHS = 500_000, 1_000_000, 22
"""Most rows that the index network learns from at a time; rows seen in all epochs after the scene is finished, and
most epochs then [0010]."""
MEASURED_ROWS = 16384
"""Rows on which the progress of a training is measured [0014]."""
SETTLED_EPOCHS = 3
"""Epochs compared with as many before to see whether training still pays [0014]."""
STEEPEST = 2.0
"""Longest gradient of a step [0010]."""
BIAS_BITS = 10.0
"""Bits that a bias of the index network is taken to cost in the file [0010]."""
LOGIT_REACH_BITS = 3.0
"""Bits by which an output vector of one unit moves the logit of a typical codeword [0010]."""
GRID_INNER_SHARE = 0.98
"""Share of the anchors, along each axis, that a hash grid's box holds: a few far away must not take its resolution
[0010]."""
AXIS_RESOLUTIONS, WAVE_RESOLUTIONS = (16, 64, 8, 32), (4, 8, 16, 32, 64)
"""Cells along an axis, per level, of learned and of given one-dimensional grids [0010]."""
GRID_FEATURES = 4
"""Features of a vertex of a learned grid [0010]."""
ANCHORS_PER_CELL = 128
"""Finest 3D cells of a learned grid hold about as many anchors: with fewer, a cell's bits cost more than they save
[0010]."""

# --- Predictors: training/networks/ ---

PREDICTOR_SAMPLE, PREDICTOR_ANCHORS = 40_000, 160_000
"""Symbols a predictor is trained on, and anchors of the tiles looked at for them [0009]."""
PREDICTOR_SAMPLE_BYTES = 1 << 28
"""Samples held at a time: those of a wide latent would fill a machine [0037]."""
PREDICTOR_LEAST_SYMBOLS = 4000
"""Fewer symbols never pay for a network [0009]."""
PREDICTOR_TABLE_BITS, PREDICTOR_ENTRY_BITS = 24.0, 6.0
"""Bits of a table and of one of its entries [0009]."""
PREDICTOR_UNITS = (8, 3, 0)
"""Hidden units tried [0009]."""
PREDICTOR_ITERATIONS = 800
"""Steps of the descent of a predictor [0009]."""
RUN_BITS = 0.1
"""Bits that a run of symbols in one context is taken to cost: a decoder opens a table for it [0009]."""
LEAST_DEVIATION = 4.0
"""Inputs that hardly vary are not blown up: their weights would not fit in 8 bits beside the others [0009]."""
WEIGHT_PENALTY_BITS, NEGLIGIBLE_WEIGHT = 24.0, 0.03
"""Weights are driven to 0 as far as the bits of one are worth more than what it saves over all symbols; below the
second number they are 0 [0009]."""
TOP_WEIGHTS = (127, 63, 31)
"""Largest magnitudes worth trying: fewer values take fewer bytes [0009]."""
LEAST_RANGE = 1e-3
"""An output that hardly varies says nothing: its buckets would only ask for large weights [0009]."""
BUCKET_PERCENTS = (1.0, 2.0)
"""Percentiles of either output beyond which the first and last bucket reach on [0009]."""
PREDICTOR_BATCH, PREDICTOR_LEARNING_RATE = 1024, 0.03
"""Rows of a step; highest learning rate [0009]."""
RISE_SHARE = 0.15
"""Share of the iterations in which the learning rate rises [0009]."""
SLOWEST, LAST_SLOWER = 25.0, 1e4
"""The learning rate starts at a 25th of its highest value and ends at a ten-thousandth of that [0009]."""
MOMENTA = (0.95, 0.85)
"""While the learning rate is low, and where it is highest [0009]."""

# --- Scenes larger than a machine: scale/ ---

PROXY_RUN, MOST_PROXIES = 128, 131_072
"""Neighbours that one Gaussian stands for where a range is drawn that they are not in; in scenes so large that there
would be more than so many, more neighbours [0044]."""
OVERVIEW_ROWS = 262_144
"""Gaussians of all ranges together that tell where the scene is and which way is up [0044]."""
SAMPLE_ROWS = 131_072
"""Gaussians of all ranges together that what holds for the whole scene is fitted to [0044]."""
RANGE_VIEWS = {1: 40, 2: 80}
"""By effort, views of each kind that a range is surveyed from at most: as many as a scene of `LOCAL_GAUSSIANS` has from
near and from inside; a large scene has many more [0044]."""
RANGE_ORBITS = {1: 12, 2: 24}
"""By effort, the same of views from outside, of which every scene has a third more [0044]."""
MEETING_ROWS = 2048
"""Gaussians of a range, drawn evenly, that tell which views meet it, and how much each shows [0044]."""
JUDGING_RANGES, JUDGED_ROWS = 8, 131_072
"""Ranges that lambda is corrected by, at most, and how many neighbours of each [0044]."""
LEAST_COVER = 0.02
"""Part of a picture that judging ranges make up at least, or it tells nothing [0044]."""
LATTICE_MARGIN_BITS = 1
"""Bits of the lattice beyond what a sample of the scene wants [0044]."""

# --- What a file opens with: opening_view.py, thumbnail.py ---

OPENING_NEIGHBOURS = 8
"""A given camera is amid its nearest neighbours, so many times fewer than all."""
OPENING_RINGS = ((1.6, 12.0, 1.0), (1.6, 35.0, 0.9), (0.8, 10.0, 1.0))
"""(radii away, elevation in degrees, factor of the score) of views around the middle: what stands is seen level."""
OPENING_TURNS, OPENING_LOOKS, OPENING_LOOK_FACTOR = 12, 8, 0.8
"""Views of a ring, and from the middle outwards; the factor of their score: whoever opens a scene wants an overview."""
OPENING_FOG = 0.4
"""What lies nearer than this part of the way to what is looked at is fog."""
OPENING_SAMPLING, DETAIL_BLOCK = 6, 3
"""Pixels of 640 x 480 that one stands for; side of the blocks of such pixels that detail is measured of."""
OPENING_GAUSSIANS = 65_536
"""Gaussians drawn, those that cover most."""
OPENING_WIDE, OPENING_FILLED = 4.5, 0.8
"""Radii from which a subject is seen whole, and the part of the frame that it then fills."""
OPENING_FRAMED, OPENING_ALONE = 0.7, 0.1
"""Opacity along the edge of the frame below which a subject stands by itself: from the first ring, and from far."""
THUMBNAIL_PART, THUMBNAIL_LEAST, THUMBNAIL_MOST = 0.01, 600, 6000
"""Bytes of a thumbnail: a share of those of the file, at least and at most; with less, no picture says anything."""
THUMBNAIL_WIDTHS, THUMBNAIL_QUALITIES = (256, 192, 128, 96), (80, 65, 50, 35)
"""Widths in pixels, and qualities of WebP, the best first."""
