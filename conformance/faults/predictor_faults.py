"""Invalid vectors of PREDICTORS blocks (SPEC §10.3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from conformance.faults.layer_faults import with_context
from conformance.faults.number_faults import WORD, ending_long
from conformance.scenes.cases import Fault
from conformance.scenes.made import Plan, build, channel
from conformance.surgery.edit import Changes, edit, further, renumber, replace_bytes
from conformance.surgery.files import block_of, blocks_of, change_block, change_numbers, numbers_of, rebuilt, without
from conformance.writer.file import write_file
from conformance.writer.numbers import numbers_block
from scarfmt.blocks.predictors import pack_predictors, unpack_predictors
from scarfmt.container.file import Block, Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES, DecodedContext, LayerRow

_PREDICTORS = BlockKind.PREDICTORS
_HEAD, _VALUES, _FIT, _ROWS = ((rule, "bad-predictor") for rule in ("R-10.3-1", "R-10.3-2", "R-10.3-3", "R-10.1-1"))
_LIMIT = "R-8.5-4", "count-limit"


def _edit(data: bytes, changes: Changes) -> bytes:
    """The file with fields of its first predictors changed."""
    before = unpack_predictors(block_of(data, _PREDICTORS).payload)
    after = edit(before, changes)
    return change_block(data, _PREDICTORS, 1, lambda _: pack_predictors(after), len(after) - len(before))


def predictor_faults(base: bytes, edge: bytes, alone: bytes) -> Iterator[Fault]:
    """Faults of the vectors `predictors`, `predictors-edge` and `predictors-alone`, which has no ROTATION."""
    for name, purpose, rule, field, value in (
        ("s-none", "a PREDICTORS block without a predictor", _HEAD, "predictor_count", 0),
        ("-residual", "a predictor of POSITION_RESIDUAL", _HEAD, "stream", int(Stream.POSITION_RESIDUAL)),
        ("-indices", "a predictor of INDICES", _HEAD, "stream", int(Stream.INDICES)),
        ("-classes", "columns of sixteen classes", _HEAD, "classes", 16),
        ("-no-inputs", "fifteen inputs", _HEAD, "inputs", 15),
        ("-units", "65 hidden units", _HEAD, "units", 65),
        ("s-1025", "1025 predictors", _LIMIT, "predictor_count", 1025),
        *((f"-{field}-256", f"{field} is 256", _LIMIT, field, 256)
          for field in ("stream", "component", "step", "b1", "b2", "classes", "inputs", "units", "shift")),
    ):
        yield f"predictor{name}", purpose, *rule, change_numbers(base, _PREDICTORS, renumber((field, value)))
    for name, purpose, rule, data, changes in _edits(base, edge, alone):
        yield f"predictor{name}", purpose, *rule, _edit(data, changes)
    yield from _order_faults(base, edge, alone)
    yield from _scene_faults(base)


def _edits(base: bytes, edge: bytes, alone: bytes) -> Iterator[tuple[str, str, tuple[str, str], bytes, Changes]]:
    reach = "an accumulator that can reach 2^24"
    yield "-buckets", "257 buckets", _VALUES, base, {"0.buckets": (129, 2)}
    yield "-step-zero", "a predictor of step 0", _VALUES, base, {"0.step": 0}
    yield "-weight-highest", "a weight of 2^31 - 1", _VALUES, base, {"0.output.weights.1.-1": (1 << 31) - 1}
    yield "-shift", "a shift of 25", _ROWS, base, {"0.output.shift": 25}
    yield "-reach", reach, _ROWS, edge, {"0.output.biases.0": further}
    yield ("-hidden-reach", "an accumulator of a hidden unit that can reach 2^24", _ROWS, edge,
           {"0.hidden.biases.0": further})
    for name, weight in (("", MAX_WEIGHT + 1), ("-low", -MAX_WEIGHT - 1)):
        alone_in_it = {"0.output": lambda layer: Linear(0 * layer.weights, 0 * layer.biases, 8)}
        yield (f"-weight{name}", f"a weight of {weight} in a row that stays in reach", _ROWS, base,
               {**alone_in_it, f"0.output.weights.0.{MAX_CLASSES}": weight})
    yield "s-equal", "two predictors of one key", _FIT, base, {"": lambda found: (found[0], *found)}
    yield "s-descend", "keys do not ascend", _FIT, base, {"": lambda found: found[::-1]}
    yield "-component", "a fourth scale", _FIT, base, {"": _fourth_scale}
    yield ("-no-channel", "a predictor of a channel that the file does not have", _FIT, alone,
           {"2.stream": Stream.ROTATION})
    yield "-no-step", "a predictor of a step that never travels", _FIT, base, {"-1.step": 20}
    yield "-early", "a predictor of a step that first travels in the next layer", _FIT, base, {"-1.step": 2}
    yield "-wide", "an input more than there is to see", _FIT, base, {"0": _wider}


def _fourth_scale(predictors: tuple[Predictor, ...]) -> tuple[Predictor, ...]:
    third = Stream.SCALE, 2
    return tuple(replace(p, component=3) if (p.stream, p.component) == third else p for p in predictors)


def _wider(predictor: Predictor) -> Predictor:
    """The predictor with an input of weight 0 more, after its other inputs."""
    at = predictor.inputs
    more = {"weights": lambda weights: np.insert(weights, at, 0, axis=1)}
    hidden = predictor.hidden and edit(predictor.hidden, more)
    return replace(predictor, hidden=hidden, output=edit(predictor.output, more))


def _order_faults(base: bytes, edge: bytes, alone: bytes) -> Iterator[Fault]:
    """R-10.3-2 is applied after the numbers of the record, and before those of the next; R-10.3-3 after the block."""
    first = pack_predictors(unpack_predictors(block_of(base, _PREDICTORS).payload)[:1])
    for name, changes in (("step-zero", {"step": 0}), ("buckets", {"b1": 128, "b2": 1})):
        numbers = renumber(*changes.items())(numbers_of(first, _PREDICTORS))
        long = numbers_block(ending_long(numbers))
        yield (f"predictor-{name}-long", "a record that breaks R-10.3-2, and ends in a number too long", "R-8.5-1",
               "bad-number", change_block(base, _PREDICTORS, 1, replace_bytes(long)))
    wide = change_block(base, _PREDICTORS, 2, lambda payload: numbers_block(
        renumber(("b1", 256))(numbers_of(payload, _PREDICTORS))))
    yield ("predictor-component-wide", "component 77 in layer 1 before 256 buckets in layer 2", "R-10.3-3 R-12.2-1",
           "bad-predictor", change_numbers(wide, _PREDICTORS, renumber(("component", 77))))
    absent = renumber(("stream", int(Stream.ROTATION)), ("shift", 256))
    yield ("predictor-no-channel-shift", "a shift of 256 before a channel that the file does not have",
           "R-8.5-4 R-12.2-1", "count-limit", change_numbers(alone, _PREDICTORS, absent))
    more = change_block(_edit(edge, {"0.output.biases.0": further}), _PREDICTORS, 1, lambda payload: WORD + payload)
    yield "predictor-reach-seal", "an accumulator that can reach 2^24, and a word too many", *_ROWS, more


def _scene_faults(base: bytes) -> Iterator[Fault]:
    """Predictors that do not fit the rest of the file."""
    blocks = blocks_of(without(base, _PREDICTORS, 2))
    late = [replace(block, layer=2) if (block.kind, block.layer) == (_PREDICTORS, 1) else block for block in blocks]
    yield ("predictor-late", "a predictor in the layer after that in which its step first travels", *_FIT,
           rebuilt(base, late))
    yield ("predictor-inputs", "as many inputs as two depths have; the file has one", *_FIT, with_context(base, 2, 40))
    # LATENT of 64 components and four depths: 15 + 3 + 64 + 4 * 66 = 346.
    channels = channel(Stream.SCALE, 0.5, 3), channel(Stream.LATENT, 1.5, 64)
    data = write_file(build(Plan(
        "wrapped inputs", channels, (LayerRow((0,), ((1, 1),)),), (Tile(0, 0, 0),), (10,), bits=5, dimension=64,
        context=DecodedContext(0, (8, 4, 2, 1)))))
    output = Linear(np.zeros((2, 346 % 256), np.int32), np.zeros(2, np.int64), 0)
    payload = pack_predictors((Predictor(Stream.LATENT, 0, 1, None, output, (1, 1)),))
    yield ("predictor-inputs-wrapped", "346 inputs, of which a byte holds 90", *_FIT,
           rebuilt(data, [*blocks_of(data), Block(_PREDICTORS, 1, payload, count=1)]))
