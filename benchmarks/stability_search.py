"""The worst input of an operation: extreme numbers at random, then hill climbing from the worst, with a fixed seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F64, Floats

TOLERANCE, NOT_COMPARED = 1e-5, 1e38
"""R-9.5-1: |a - b| <= 10^-5 max(1, m), m at least |b|; any a will do where m is above 10^38 or b is not a number."""

_KEPT, _CHILDREN = 48, 40
_SPECIAL = (0.0, 1.0, 0.5, 2.0, 3.0, 1 / 3, np.pi, np.pi / 2, 88.0, 2.0**-13, 2.0**-24, 2.0**24, 2.0**-126, 2.0**-149)


@dataclass(frozen=True)
class Operation:
    """An activated value of SPEC §9.3 to §9.6.

    Attributes:
        name: as the table shows it.
        columns: of its input, by name.
        low, high: binary exponents of the magnitudes that are legal, least and largest, of each column.
        evaluate: (n, columns) of `dtype` -> (n, out) as a decoder gives them in float32.
        reference: (n, columns) float64 -> b and m of R-9.5-1, or |b| where that is larger; (n, out) float64 each.
        dtype: of inputs.
    """

    name: str
    columns: tuple[str, ...]
    low: tuple[int, ...]
    high: tuple[int, ...]
    evaluate: Callable[[Floats], Floats]
    reference: Callable[[F64], tuple[F64, F64]]
    dtype: type = np.float32


@dataclass(frozen=True)
class Worst:
    """The worst case found.

    Attributes:
        used: error as a part of the tolerance; above 1 it breaks R-9.5-1. Infinite where no number is given.
        error: |a - b|.
        ulps: the same in units of the last place of b in float32.
        inputs: (columns).
        found, wanted: a and b of the worst output.
        cases: outputs compared.
    """

    used: float
    error: float
    ulps: float
    inputs: tuple[float, ...]
    found: float
    wanted: float
    cases: int


def used_tolerance(a: F64, b: F64, m: F64) -> F64:
    """Errors as parts of the tolerance; 0 where any a will do."""
    with np.errstate(all="ignore"):
        used = np.abs(a - b) / (TOLERANCE * np.maximum(1, m))
        used = np.where(np.isnan(used), np.inf, used)
    used = np.where(a == b, 0.0, used)
    return np.asarray(np.where(np.isnan(b) | ~(m <= NOT_COMPARED), 0.0, used))


def _measured(operation: Operation, x: Floats) -> tuple[F64, F64, F64]:
    """(n, out) parts of the tolerance, a, b."""
    with np.errstate(all="ignore"):
        a = operation.evaluate(x).astype(np.float64)
        b, m = operation.reference(x.astype(np.float64))
    return used_tolerance(a, b, m), a, b


def extreme_inputs(operation: Operation, rng: np.random.Generator, count: int) -> Floats:
    """Magnitudes of every exponent, ordinary numbers, special ones, and columns that nearly cancel."""
    shape = (count, len(operation.columns))
    low, high = np.array(operation.low, np.float64), np.array(operation.high, np.float64)
    x = np.exp2(rng.uniform(np.broadcast_to(low, shape), high)) * rng.choice([-1, 1], shape)
    kind = rng.integers(0, 5, shape)
    x = np.where(kind == 0, rng.normal(size=shape), x)
    x = np.where(kind == 1, rng.choice(_SPECIAL, shape) * rng.choice([-1, 1], shape), x)
    same = rng.random(count) < 0.3
    # Of one magnitude, a few places apart.
    x[same] = x[same, :1] * rng.choice([-1, 1], x[same].shape) * (1 + rng.integers(-4, 5, x[same].shape) * 2.0**-23)
    return _legal(operation, x)


def _legal(operation: Operation, x: F64) -> Floats:
    top = np.exp2(np.array(operation.high, np.float64))
    return np.clip(x, -top, top).astype(operation.dtype)


def _changed(operation: Operation, rng: np.random.Generator, x: Floats) -> Floats:
    """Each row again and again, with one number or all a little or a lot different."""
    out = np.repeat(x.astype(np.float64), _CHILDREN, axis=0)
    one = rng.integers(0, out.shape[1], len(out))[:, None] == np.arange(out.shape[1])
    chosen = one | (rng.random(len(out)) < 0.2)[:, None]
    small = 1 + rng.integers(-8, 9, out.shape) * 2.0 ** -rng.integers(10, 25, out.shape).astype(np.float64)
    large = np.exp2(rng.normal(size=out.shape) * 3) * rng.choice([1, 1, 1, -1], out.shape)
    factor = np.where(rng.random(out.shape) < 0.6, small, large)
    with np.errstate(all="ignore"):
        return _legal(operation, np.where(chosen, out * factor, out))


def search(operation: Operation, count: int, rounds: int, seed: int = 1) -> Worst:
    """The largest part of the tolerance found.

    Args:
        operation: what is tried.
        count: random inputs to begin with.
        rounds: of climbing, each of some two thousand inputs.
        seed: of everything random.
    """
    rng = np.random.default_rng(seed)
    pool = extreme_inputs(operation, rng, count)
    used, _, b = _measured(operation, pool)
    cases = b.size
    for _ in range(rounds):
        best = np.argsort(-used.max(axis=1), kind="stable")[:_KEPT]
        pool, used = pool[best], used[best]
        children = _changed(operation, rng, pool)
        found, _, b = _measured(operation, children)
        cases += b.size
        pool, used = np.concatenate([pool, children]), np.concatenate([used, found])
    row = int(used.max(axis=1).argmax())
    return _described(operation, pool[row : row + 1], cases)


def _described(operation: Operation, x: Floats, cases: int) -> Worst:
    used, a, b = _measured(operation, x)
    at = int(used[0].argmax())
    error = abs(a[0, at] - b[0, at])
    place = float(np.spacing(np.float32(abs(b[0, at])))) if abs(b[0, at]) < 3.4e38 else np.inf
    inputs = tuple(map(float, x[0]))
    found, wanted = float(a[0, at]), float(b[0, at])
    return Worst(float(used[0, at]), float(error), float(error / place), inputs, found, wanted, cases)


def profile(operation: Operation, exponents: range, count: int, seed: int = 2) -> list[float]:
    """The largest part of the tolerance of inputs whose numbers all have about the same magnitude, by exponent."""
    rng = np.random.default_rng(seed)
    out = []
    for exponent in exponents:
        shape = (count, len(operation.columns))
        x = np.exp2(exponent + rng.random(shape)) * rng.choice([-1, 1], shape)
        out.append(float(_measured(operation, _legal(operation, x))[0].max()))
    return out
