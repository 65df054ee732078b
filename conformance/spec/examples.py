"""The worked examples that stand beside the rules of SPEC.md, as block quotes.

Their numbers are those of ``example_symbols``, ``example_values`` and ``example_networks``; here they become sentences.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable
from functools import partial
from itertools import pairwise

import numpy as np

from conformance.decoders.python.fields import cumulative, key
from conformance.spec import example_networks as networks
from conformance.spec import example_symbols as symbols
from conformance.spec import example_values as values

_WIDTH = 120
_JOINED = "\0"
_LOOKS_LIKE_A_LIST = re.compile(r"[-+*=>] |\d+[.)] ")


def _quoted(text: str) -> str:
    """A paragraph of SPEC.md that is informative."""
    kept = re.sub(r"`[^`]*`", lambda code: code[0].replace(" ", _JOINED), f"**Example.** {text}")
    lines = textwrap.wrap(kept, _WIDTH - 2, break_long_words=False, break_on_hyphens=False)
    if any(_LOOKS_LIKE_A_LIST.match(line) for line in lines):
        raise ValueError(f"a line would begin a list: {lines}")
    return "".join(f"> {line.replace(_JOINED, ' ')}\n" for line in lines)


def _spaced(numbers: Iterable[int]) -> str:
    return " ".join(map(str, numbers))


def _positions() -> str:
    whole, halves, rest = symbols.tree(symbols.CODES, symbols.LOCAL_BITS)
    first, second = symbols.CODES
    top = 3 * symbols.LOCAL_BITS - 1
    return (
        f"Two anchors have the local codes {first} and {second}, b = {symbols.LOCAL_BITS}. Bit {top}: the table of "
        f"{whole.number} gives {whole.values[0]}, so both codes are below {1 << top}. Bit {top - 1}: it gives "
        f"{halves.values[0]}, so one is below {1 << (top - 1)}. Now each is alone, with {top - 1} bits open, and "
        f"`uniform({rest.number}, 2)` gives {rest.values[0]} and {rest.values[1]}: the codes are {rest.values[0]} and "
        f"`{1 << (top - 1)} + {rest.values[1]} = {second}`."
    )


def _splits() -> str:
    (count, lower), (many, few) = symbols.SPLIT, symbols.WIDE_SPLIT
    bin_, rest = symbols.split(count, lower)
    wide, high, low = symbols.split(many, few)
    width = (high.values[0] << 12) + 1
    return (
        f"A node of {count} anchors, {lower} of them in the lower half. An encoder finds the bin "
        f"`{lower} * 16 // {count + 1}` = {bin_.values[0]}. The bin begins at {lower - rest.values[0]} and has "
        f"width {rest.number}, so the rest is read by `uniform({rest.number}, 1)`: {rest.values[0]}, and "
        f"`{lower - rest.values[0]} + {rest.values[0]} = {lower}`. Of {many} anchors, {few} in the lower half: bin "
        f"{wide.values[0]} begins at 0 and has width {width}, above 4096; `uniform({high.number}, 1)` gives high "
        f"{high.values[0]}, `uniform({low.number}, 1)` gives {low.values[0]}, and the rest is {few}."
    )


def _masks() -> str:
    groups = symbols.masks()
    said = [f"s = {s}: contexts {_spaced(c)}, bits {_spaced(b)}" for s, (c, b) in enumerate(groups)]
    return (
        "Two anchors of three slots; slot 1 of anchor 0 has been on since an earlier layer. Slot 0 of anchor "
        "0 and slot "
        f"2 of anchor 1 turn on. {'; '.join(said)}. Anchor 0 is not asked about slot 1. Its context for slot 2 is "
        f"{groups[2][0][0]}, as slot 0 counts already."
    )


def _frequencies() -> str:
    c = cumulative(symbols.WEIGHTS)
    shares = [past - low for low, past in pairwise(c)]
    return (
        f"The weights {_spaced(symbols.WEIGHTS)} give the sums {_spaced(c)} and the frequencies {_spaced(shares)}. The "
        "frequencies are not exactly in proportion, as every symbol gets 1 before the rest is shared."
    )


def _rans() -> str:
    words, states = symbols.states()
    steps = ", ".join(f"{s} (0x{state:X})" for s, state in zip(symbols.SYMBOLS, states[1:], strict=True))
    return (
        f"The symbols {_spaced(symbols.SYMBOLS)} of the table of the weights {_spaced(symbols.WEIGHTS)} (§8.1) are "
        f"{_counted(words)} {' '.join(f'0x{word:08X}' for word in words)}. After `open` the state is 0x{states[0]:X}; "
        f"then the symbols and the state after each are {steps}. The stream is sealed: the state is 0 and no "
        "word is left."
    )


def _counted(words: list[int]) -> str:
    return "the one word" if len(words) == 1 else f"the {len(words)} words"


def _key() -> str:
    stream, component, step, context = symbols.KEY
    return f"key(SCALE, {component}, {step}, {context}) is 0x{key(stream, component, step, context):08X}."


def _contexts() -> str:
    rule, refined = symbols.RULE, symbols.REFINED
    bucket = symbols.first_context() - 16 * symbols.CLASS
    return (
        f"An anchor of class {symbols.CLASS}, by_class 1, shift {rule.shift}, low {rule.low}. First step: the "
        "source is "
        f"{symbols.SOURCE}, `({symbols.SOURCE} - ({rule.low})) >> {rule.shift}` is {bucket}, and the context is "
        f"`16 * {symbols.CLASS} + {bucket}` = {symbols.first_context()}. Later steps: the values "
        f"{_spaced(refined)}, before they "
        f"are refined, have the contexts {_spaced(symbols.trit_contexts())}."
    )


def _widths() -> str:
    found, n, v = values.value(), values.STEPS, values.VALUE
    return (
        f"first_width = {values.FIRST_WIDTH}, v = {v} after {n} steps. `w({n}) = {values.FIRST_WIDTH} / "
        f"{3 ** (n - 1)}` is "
        f"{found.width!r} in f64; the product `{v} * w({n})` is {found.product!r} in f64, and the value "
        f"{np.float32(found.value)!s} in f32. Dividing by 3 twice instead gives {found.divided_again!r}, "
        "another number."
    )


def _position() -> str:
    r, t, x = values.position()
    return (
        f"corner {values.CORNER}, local {values.LOCAL}, shift {values.SHIFT}; the residual is {values.RESIDUAL} after "
        f"{values.RESIDUAL_STEPS} steps, with first_width 1/3. r is {r:.6g}, place is {t:.8g}, and with "
        f"origin {values.ORIGIN} "
        f"and voxel {values.VOXEL} the coordinate is {x:.8g}."
    )


def _rotation() -> str:
    u, v, twist = values.ROTATION
    w, *xyz = (f"{number:.6f}" for number in values.rotation())
    return f"g = {u}, h = {v}, twist = {twist} give the quaternion `({', '.join([w, *xyz])})`, to six digits."


def _opacity() -> str:
    (logit, opacity), (most, largest) = values.opacities()
    y, g, o = values.COLOUR
    red, green, blue = values.colour()
    return (
        f"y = {values.LOG_OPACITIES[0]} gives the logit {logit:.6f} and the opacity {opacity:.6f}; y = 0 gives "
        f"{most:.6f} and {largest:.6f}. COLOUR `({y}, {g}, {o})` gives red {red}, green {green}, blue {blue}."
    )


def _gains() -> str:
    viewpoint, layer, tile = values.GAIN_AT
    low, high = values.tight_box()
    side = values.SIDE
    return (
        f"Of {values.VIEWPOINTS} viewpoints, {values.LAYERS} layers and {values.TILES} tiles, the gain of viewpoint "
        f"{viewpoint}, layer {layer}, tile {tile} is byte {values.gain_byte()} of `gains`: "
        f"`({viewpoint} * {values.LAYERS} + {layer - 1}) * {values.TILES} + {tile}`. A gain of {values.GAIN} is "
        f"`2^(({values.GAIN} - 255) / 4)` = {values.gain_share()} of squared error. In a tile of side {side}, "
        f"low {values.LOW} and high {values.HIGH} stand "
        f"for {low} to {high} from the corner, and a reach of {values.REACH} for {values.reach()}."
    )


def _fine() -> str:
    pairs = zip(networks.FINE, networks.fine_values(), strict=True)
    return "; ".join(f"`fine({v}, {n}) = {result}`" for (v, n), result in pairs) + "."


def _passes() -> str:
    found = "; ".join(_spaced(part) for part in networks.passes())
    return f"{networks.COHORT} anchors, passes_log2 = 2. By rank in the cohort, the passes are: {found}."


def _around() -> str:
    (first, number), (second, other) = ((networks.CODES[a], x) for a, x in networks.KNOWN.items())
    near, far = networks.around()
    depths = networks.context().depths
    code, alone = (networks.CODES[a] for a in networks.LOOKED_FROM)
    return (
        f"The local codes of the anchors known are {_spaced(networks.CODES)}, b = {networks.LOCAL_BITS}. The targets "
        f"{_spaced(networks.TARGETS)} give the depths {_spaced(depths)}: {len(networks.CODES)} anchors are in "
        "1 cell of "
        f"depth 2, in 3 of depth 1, in 6 of depth 0. E holds the anchor of code {first} with the number "
        f"{number} and that "
        f"of code {second} with {other}. The anchor of code {code} has the means {_spaced(near.means)} and the count "
        f"features {_spaced(near.counts)}: `{number + other} / 2` is rounded up to {near.means[0]}. The anchor of code "
        f"{alone} has {_spaced(far.means)} and {_spaced(far.counts)}: its cell of depth {depths[1]} has "
        "nothing in E, so "
        "the mean at the depth before stands again."
    )


def _predictor() -> str:
    found, (b1, b2) = networks.evaluated(), networks.BUCKETS
    weights, bias, shift = networks.HIDDEN
    stored, biases, output_shift = networks.OUTPUT
    rows = [
        ("classes, inputs, units; B1, B2", f"{networks.CLASS + 1}, {len(found.inputs)}, 1; {b1}, {b2}"),
        ("hidden: stored row, bias, shift", f"{_spaced(weights)}; {bias}; {shift}"),
        (
            "output: stored rows, biases, shift",
            f"{_spaced(stored[0])} and {_spaced(stored[1])}; {_spaced(biases)}; {output_shift}",
        ),
        ("x: class columns 0..14", _spaced(found.inputs[:15])),
        (f"x: fine values {_spaced(networks.BEFORE)} of SCALE, >> 6", _spaced(found.inputs[15:18])),
        (f"x: fine0 = fine({networks.VALUE}, {networks.STEP - 1}) = 3072, >> 6", str(found.inputs[18])),
        (f"x: means {_spaced(row[0] for row in networks.MEANS)}, >> 6", _spaced(found.inputs[19:21])),
        ("x: count features, of 9 anchors and of 2", _spaced(found.inputs[21:23])),
        (f"x: (mean - fine0) * 3^{networks.STEP - 1}, shifted by 5", _spaced(found.inputs[23:])),
        ("u", _spaced(found.hidden)),
        ("o0, o1", _spaced(found.outputs)),
        ("context", f"{found.outputs[0]} * {b2} + {found.outputs[1]} = {found.context}"),
    ]
    head = _quoted(
        f"A predictor of step {networks.STEP} of OPACITY in a file with SCALE before it and two depths, for "
        "an anchor of "
        f"class {networks.CLASS} with v = {networks.VALUE}."
    )
    table = ["| what | numbers |", "|---|---|", *(f"| {what} | {numbers} |" for what, numbers in rows)]
    return head + ">\n" + "".join(f"> {line}\n" for line in table)


def _grid() -> str:
    found, level, box = networks.summed(), networks.PLANE, networks.BOX
    terms = [
        f"{entry} ({'+' if entry in networks.ONES else '-'}{weight})"
        for entry, weight in zip(found.entries, found.weights, strict=True)
    ]
    hashed, vertex = networks.HASHED, networks.VERTEX
    return (
        f"Plane xy, resolution {level.resolution}, table_log2 {level.table_log2}, origin "
        f"{_spaced(box.origin)}, extent_bits "
        f"{box.extent_bits}, an anchor at {_spaced(networks.POINT)}. The cell is {_spaced(found.cells)}, the parts are "
        f"{_spaced(found.parts)}. The level is dense. The entries of the vertices, with their weights, whose "
        "sign is that "
        f"of the bit, are {', '.join(terms)}. They sum to {found.total}, and the feature is {found.feature}. "
        "In a level of "
        f"three axes with resolution {hashed.resolution} and table_log2 {hashed.table_log2}, which is not "
        "dense, the vertex "
        f"({', '.join(map(str, vertex))}) has the entry {networks.hashed_entry()}."
    )


_TEXTS: dict[str, Callable[[], str]] = {
    "positions": _positions,
    "splits": _splits,
    "masks": _masks,
    "gains": _gains,
    "frequencies": _frequencies,
    "rans": _rans,
    "key": _key,
    "contexts": _contexts,
    "position": _position,
    "widths": _widths,
    "rotation": _rotation,
    "opacity": _opacity,
    "fine": _fine,
    "passes": _passes,
    "around": _around,
    "grid": _grid,
}


def example_parts() -> dict[str, Callable[[], str]]:
    """The generated parts ``example-NAME`` of SPEC.md."""

    def text(make: Callable[[], str]) -> str:
        return _quoted(make())

    parts: dict[str, Callable[[], str]] = {f"example-{name}": partial(text, make) for name, make in _TEXTS.items()}
    return {**parts, "example-predictor": _predictor}
