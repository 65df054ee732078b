"""Exact values computed in floating point, and rANS with extreme tables, against Python's integers and fractions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from conformance.decoders.python.arithmetic import exp2w
from reference_decoder.dequantise import latents, positions
from scarfmt.container.directory import Tile
from scarfmt.container.morton import interleave
from scarfmt.engines import absence, best_engine
from scarfmt.entropy.rans import (
    MAX_ALPHABET,
    TOTAL,
    FrequencyTable,
    PureRansDecoder,
    RansDecoder,
    RansEncoder,
    SymbolSource,
)
from scarfmt.neural.context import FINE_LIMIT, CellMeans
from scarfmt.neural.context_operations import fine
from scarfmt.neural.operations import NUMPY
from scarfmt.neural.tables import EXP2_LAST, SIGMOID, TANH, exp2_table
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import MAX_STEPS, Lattice

Edge = dict[str, Any]

LARGEST = 2**31 - 1
_BITS32, _LEAST32, _MOST32 = 24, -149, 128
_SYMBOLS = 300


def measure_values(count: int) -> list[Edge]:
    """The comparisons: what was compared, how often, the worst case, its limit, and how many differ.

    Args:
        count: cases of each kind.
    """
    rng = np.random.default_rng(9)
    parts = [_channels(rng, count), _positions(rng, count), _latents(rng, count), _fine(rng, count), _means(rng, count)]
    return [*parts, _tables(rng), _coder(rng), *_compiled_logits(rng), *_literal_tables()]


def _edge(operation: str, cases: int, worst: str, limit: str, differ: int) -> Edge:
    return {"operation": operation, "cases": cases, "worst": worst, "limit": limit, "differ": int(differ)}


def rounded32(value: Fraction) -> float:
    """`value` in binary32: to nearest, ties to even, subnormal numbers and infinities included."""
    if not value:
        return 0.0
    exponent = math.floor(math.log2(abs(value.numerator)) - math.log2(value.denominator)) - 1
    while abs(value) >= Fraction(2) ** (exponent + 1):
        exponent += 1
    place = max(exponent - _BITS32 + 1, _LEAST32)
    # Python rounds a fraction to an integer with ties to even.
    whole = round(value / Fraction(2) ** place)
    out = Fraction(whole) * Fraction(2) ** place
    if abs(out) >= Fraction(2) ** _MOST32:
        return math.inf if out > 0 else -math.inf
    return float(out)


def _channels(rng: np.random.Generator, count: int) -> Edge:
    """Integers, cell widths and steps up to their limits; f64 products and f32 results down to subnormal numbers."""
    v = np.where(rng.random(count) < 0.3, LARGEST, rng.integers(0, LARGEST, count)) * rng.choice([-1, 1], count)
    step = np.exp2(rng.uniform(-1074, 96, count))
    step[:20] = [2.0**96, 5e-324, 2.0**-126, 2.0**-149, 1 / 3] * 4
    steps = rng.integers(1, MAX_STEPS + 1, count)
    steps[::3] = MAX_STEPS
    differ, worst, at = 0, 0.0, ""
    for value, width, n in zip(v.tolist(), step.tolist(), steps.tolist(), strict=True):
        found = float(best_engine().channel_values(np.array([[value]], np.int32), [width], np.array([n]))[0, 0])
        true = Fraction(width) / 3 ** (n - 1)
        differ += found != rounded32(Fraction(float(Fraction(float(true)) * value)))
        apart = float(abs(Fraction(found) - true * value) / Fraction(2) ** max(_exponent(found) - 23, _LEAST32))
        if apart > worst and abs(found) >= 2.0**-126:
            worst, at = apart, f"v {value}, step {width:.9g}, {n} steps"
    return _edge("value of a channel", count, f"{worst:.4f} ulp from v · step / 3ⁿ⁻¹ itself: {at}", "R-9.2-1", differ)


def _exponent(value: float) -> int:
    return math.frexp(value)[1] - 1 if value else _LEAST32


def _positions(rng: np.random.Generator, count: int) -> Edge:
    """Lattices of 1 to 32 bits in worlds of 1e-300 to 1e300, from the first cell to the farthest corner."""
    differ, worst, at = 0, 0.0, ""
    for _ in range(count):
        bits = int(rng.choice([1, 21, 32, int(rng.integers(1, 33))]))
        depth = int(rng.integers(max(0, bits - 52), min(bits, 21) + 1))
        free = bits - depth
        shift = int(rng.integers(max(0, free - 21), min(free, 31) + 1))
        side, cells = 1 << depth, 1 << (free - shift)
        place = [int(rng.choice([0, side - 1, int(rng.integers(0, side))])) for _ in range(3)]
        local = [int(rng.choice([0, cells - 1, int(rng.integers(0, cells))])) for _ in range(3)]
        voxel = float(10.0 ** rng.choice([-300, -30, -3, 0, 30, 290]) * rng.uniform(0.1, 1))
        origin = float(rng.choice([0, 1, -1, 1e6, voxel, -voxel * 2.0**bits]) * rng.uniform(0.5, 1))
        residual = float(rng.choice([0, 1, -1, rng.uniform(-1, 1)]))
        prefix, code = (int(interleave(np.array([p], np.uint64))[0]) for p in (place, local))
        found = positions(
            Lattice((origin,) * 3, voxel, bits), Tile(depth, shift, prefix), np.array([code], np.uint64),
            np.full((1, 3), residual),
        )[0]  # fmt: skip
        for axis in range(3):
            corner = (place[axis] << free) + (local[axis] << shift)
            exact = Fraction(corner) + Fraction(1 << shift) / 2
            t = float(exact + Fraction(float(Fraction(1 << shift) * Fraction(residual))))
            wanted = float(Fraction(origin) + Fraction(float(Fraction(voxel) * Fraction(t))))
            differ += found[axis] != wanted
            true = Fraction(origin) + Fraction(voxel) * (exact + (1 << shift) * Fraction(residual))
            # In places of the larger addend: where they cancel, a sum has fewer digits.
            largest = max(abs(origin), abs(voxel * t), abs(found[axis]))
            apart = float(abs(Fraction(float(found[axis])) - true) / Fraction(math.ulp(largest)))
            if apart > worst:
                worst, at = apart, f"{bits} bits, shift {shift}, voxel {voxel:.3g}, origin {origin:.3g}"
    return _edge("position", 3 * count, f"{worst:.4f} ulp from exact arithmetic: {at}", "R-9.1-1", differ)


def _latents(rng: np.random.Generator, count: int) -> Edge:
    """Eight stages of the largest codewords, with refinements of every magnitude."""
    words = rng.choice([-65535, 65535, 1, 0], (4, 4))
    books = Codebooks(words, words[::-1].copy())
    codes = rng.integers(0, 4, (count, 8))
    codes[0] = 0
    stages = rng.integers(0, 9, count)
    refined = (np.exp2(rng.uniform(-149, 127, (count, 4))) * rng.choice([-1, 1], (count, 4))).astype(np.float32)
    found = latents(books, codes.astype(np.int16), stages, refined, 4)
    differ = worst = 0
    for row in range(count):
        picked = [(books.coarse if k == 0 else books.residual)[codes[row, k]] for k in range(int(stages[row]))]
        sums = np.sum(picked, axis=0).tolist() if picked else [0] * 4
        worst = max(worst, *map(abs, sums))
        wanted = [rounded32(Fraction(s) + Fraction(float(r))) for s, r in zip(sums, refined[row], strict=True)]
        differ += int(np.count_nonzero(found[row].astype(np.float64) != wanted))
    return _edge("latent", 4 * count, f"sum of codewords {worst:,}", "R-9.2-2", differ)


def _fine(rng: np.random.Generator, count: int) -> Edge:
    """Quotients at ties, and one to both sides, at every step."""
    cases = differ = 0
    for n in range(1, MAX_STEPS + 1):
        power = 3 ** (n - 1)
        # v = (2k + 1) 3^(n-1) / 2048 is a tie.
        near = ((2 * rng.integers(-(2**30), 2**30, count // 20) + 1) * power) // 2048
        v = np.concatenate([near, near + 1, [0, LARGEST, -LARGEST, power, -power], rng.integers(-LARGEST, LARGEST, 20)])
        v = v[np.abs(v) <= LARGEST]
        wanted = [max(-FINE_LIMIT, min(FINE_LIMIT, (2048 * x + power) // (2 * power))) for x in v.tolist()]
        differ += int(np.count_nonzero(fine(v[:, None], np.array([n]), best_engine())[:, 0] != wanted))
        cases += len(v)
    return _edge("fine value", cases, f"v {LARGEST:,}, {MAX_STEPS} steps: 2048 v + 3ⁿ⁻¹ = 2^42.0", "§10.2", differ)


def _means(rng: np.random.Generator, count: int) -> Edge:
    """Means one part in 2n below an integer: the hardest quotients, of up to 65,536 anchors and the largest values."""
    cases = differ = 0
    worst = 0
    for size in (1, 2, 3, 1000, 65536):
        cells = CellMeans(np.zeros(size, np.uint64), [0])
        for _ in range(max(count // 100, 4)):
            some = [-FINE_LIMIT, FINE_LIMIT, FINE_LIMIT - 1, *rng.integers(-FINE_LIMIT, FINE_LIMIT, 9).tolist()]
            values = rng.choice(some, size)
            # 2 S + n = 2 n k - 1 where that can be.
            values[0] += ((-1 - size) // 2 - int(values.sum())) % size - size
            sums = best_engine().cell_sums(cells, 1)
            sums.add(np.arange(size), values[:, None])
            total = int(values.sum())
            found = int(sums.around(np.array([0]))[0].ravel()[0])
            differ += found != (2 * total + size) // (2 * size)
            worst = max(worst, abs(2 * total + size))
            cases += 1
    return _edge("mean of a cell", cases, f"numerator {worst:,}", "§10.2", differ)


def _weights(rng: np.random.Generator) -> Iterator[list[int]]:
    top = 2**24 - 1
    yield from ([1], [top], [1, top], [top, 1], [1] * MAX_ALPHABET, [top] * MAX_ALPHABET)
    yield [1] * (MAX_ALPHABET - 1) + [top]
    yield [top] + [1] * (MAX_ALPHABET - 1)
    for _ in range(40):
        yield np.exp2(rng.uniform(0, 23.9, int(rng.integers(1, MAX_ALPHABET + 1)))).astype(np.int64).tolist()


def _tables(rng: np.random.Generator) -> Edge:
    """Static tables of the steepest and the largest weights."""
    cases = differ = worst = 0
    for weights in _weights(rng):
        total, n, before, wanted = sum(weights), len(weights), 0, []
        for weight in weights:
            after = before + weight
            ends = [c * (TOTAL - n) // total for c in (before, after)]
            wanted.append(ends[1] - ends[0] + 1)
            before = after
        worst = max(worst, total * (TOTAL - n))
        differ += int(np.count_nonzero(FrequencyTable.from_weights(np.array(weights)).frequencies != wanted))
        cases += n
    return _edge("static frequency table", cases, f"product 2^{math.log2(worst):.1f} of at most 2^63", "§8.1", differ)


def _decoders(data: bytes) -> list[SymbolSource]:
    """Every decoder there is, at the start of a stream."""
    compiled = [] if absence() is not None else [best_engine().rans_decoder(data)]
    return [RansDecoder(data), PureRansDecoder(data), *compiled]


def _unasked() -> NDArray[np.float64]:
    """The rows that a reader asks for where it takes no logits: the compiled one does."""
    raise AssertionError


def _compiled_logits(rng: np.random.Generator) -> list[Edge]:
    """Symbols the compiled decoder finds from logits itself: all equal, far apart, beyond the table, at their ends."""
    cases = differ = 0
    if absence() is not None:
        return []
    for size in (2, 3, 63, 64, 65, 1000, MAX_ALPHABET):
        logits = np.round(rng.normal(size=(size, _SYMBOLS)) * rng.choice([0, 1, 30, 150, 1e6], _SYMBOLS))
        logits = np.clip(logits, -TOTAL + 1, TOTAL - 1).astype(np.float32)
        logits[:, 0] = rng.choice([1 - TOTAL, TOTAL - 1], size)
        logits[:, 1] = rng.choice([0, -511, -512], size)
        words = rng.integers(1, 2**32, 2 * _SYMBOLS, dtype=np.uint64).astype("<u4").tobytes()
        found = best_engine().symbol_reader(words, {}).read_logits(logits, _unasked, 1)
        weights = NUMPY.frequency_rows(logits.copy(), NUMPY.constant(exp2_table()))
        differ += int(np.count_nonzero(found != RansDecoder(words).decode_rows(weights)))
        cases += found.size
    return [_edge("rANS from logits, compiled", cases, f"{MAX_ALPHABET:,} equal logits", "R-10.5-10", differ)]


def _coder(rng: np.random.Generator) -> Edge:
    """Runs of the rarest, the commonest and mixed symbols, by tables and by rows, with every decoder."""
    cases = differ = 0
    for size in (2, 3, 255, MAX_ALPHABET):
        for place in (0, size - 1):
            f = np.ones(size, np.int64)
            f[place] = TOTAL - size + 1
            table = FrequencyTable(f)
            rare = (place + 1) % size
            mixed = np.where(rng.random(_SYMBOLS) < 0.5, place, rng.integers(0, size, _SYMBOLS))
            for symbols in (np.full(_SYMBOLS, rare), np.full(_SYMBOLS, place), mixed):
                encoder, rows = RansEncoder(), np.repeat((f - 1.0)[None], 40, axis=0)
                encoder.encode(symbols, table)
                encoder.encode_rows(symbols[:40], rows)
                data = encoder.finish()
                for decoder in _decoders(data):
                    found = np.concatenate([decoder.decode(table, _SYMBOLS), decoder.decode_rows(rows)])
                    decoder.finish()
                    differ += int(np.count_nonzero(found != np.concatenate([symbols, symbols[:40]])))
                    cases += len(found)
    return _edge("rANS", cases, f"frequencies 1 and 2^24 - {MAX_ALPHABET - 1:,}: 24 bits and 0.0004", "§8.2", differ)


def _literal_tables() -> list[Edge]:
    """TANH, SIGMOID and EXP2 are what their formulas give, and how far exp2w is from a power of two."""
    with mpmath.workdps(40):
        tanh = [int(mpmath.nint(2047 * mpmath.tanh(mpmath.mpf(u) / 32))) for u in range(256)]
        sigmoid = [int(mpmath.nint(4096 / (1 + mpmath.exp(-mpmath.mpf(u) / 32)))) for u in range(256)]
    differ = sum(a != b for a, b in zip([*TANH, *SIGMOID], [*tanh, *sigmoid], strict=True))
    found = exp2_table().tolist()
    differ_exp = sum(exp2w(d) != weight for d, weight in enumerate(found))
    apart = [abs(weight - 65536 * 2.0 ** (-d / 32)) for d, weight in enumerate(found)]
    worst = max(range(EXP2_LAST + 1), key=apart.__getitem__)
    return [
        _edge("tanh and sigmoid tables", 512, "half a unit", "§10.1", differ),
        _edge("exp2w", len(found), f"{apart[worst]:.3f} units of 2⁻¹⁶ from 2^(-d/32): d {worst}", "§10.1", differ_exp),
    ]


def reaches() -> list[tuple[str, int, int, str]]:
    """(what, the largest magnitude it can have, what that has to stay below, rule) of SPEC appendix A."""
    hidden, activation, share = 256, 2047, 256
    return [
        ("sum of a linear layer, f32", 2**24 - 1, 2**24, "R-10.1-1, checked"),
        ("both sums of a recurrent layer, f32", 2 * (2**23 - 1), 2**24, "R-10.5-3, checked"),
        ("z g + (4096 - z) n, f32", 4096 * activation, 2**24, "§10.5"),
        ("score of attention, f32", hidden * 127 * 127, 2**24, "§10.5"),
        ("sum of shares times values, f32", share * activation, 2**24, "§10.5"),
        ("sum of 64 weights exp2w, f32", 64 * 2**16, 2**24, "§10.5"),
        ("sum of codewords, f32", 8 * 65535, 2**24, "R-9.2-2"),
        ("C (2^24 - n) of a row, f64", MAX_ALPHABET * 2**16 * (2**24 - MAX_ALPHABET), 2**53, "R-10.5-10"),
        ("2048 v + 3^(n-1), f64", 2048 * LARGEST + 3**19, 2**53, "§10.2"),
        ("2 S + n of a cell, f64", 2 * 2**24 * 2**21 + 2**21, 2**53, "R-10.2-5"),
        ("lattice coordinate in halves, f64", 2 * 2**32 + 1, 2**53, "§9.1"),
        ("sum of vertex weights, i32", 2**24, 2**31, "R-10.6-3"),
        ("C (2^24 - n) of a static table, i64", MAX_ALPHABET * (2**24 - 1) * 2**24, 2**63, "§8.1"),
        ("state of rANS, u64", 2**24 * 2**40 - 1, 2**64, "§8.2"),
        ("local code, u64", 2**63 - 1, 2**64, "R-5.4-8"),
    ]
