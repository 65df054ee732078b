"""The report about the STREAMING block of a file, for people and scripts (SPEC §7.13)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.blocks.streaming import GAIN_OF_ONE, GAIN_STEPS, Streaming, read_streaming
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind


def describe_streaming(container: Container) -> dict[str, Any] | None:
    """A JSON-able description; None where there is no such block, or a cut source does not reach it.

    Returns:
        ``bytes``, ``layers`` that gains are told of, ``viewpoints`` as lists of x, y, z; ``view`` to begin with as
        ``position``, ``target``, ``up`` and ``fov`` (radians), or None; ``gain_db``: of each layer what it takes away
        of the squared error, 10 log10 of the sum over tiles, mean over viewpoints, None where no gain is told;
        ``box_share``: mean share of a tile's cube that its box takes up.

    Raises:
        Malformed, LimitExceeded: the block is refused.
    """
    entry = container.find(BlockKind.STREAMING, 1)
    streaming = read_streaming(container)
    if entry is None or streaming is None:
        return None
    view = streaming.view
    sides = (streaming.high.astype(np.float64) + 1 - streaming.low) / 256
    return {
        "bytes": entry.length,
        "layers": streaming.layers,
        "viewpoints": streaming.viewpoints.astype(np.float64).tolist(),
        "view": None
        if view is None
        else {
            "position": view.position.tolist(),
            "target": view.target.tolist(),
            "up": view.up.tolist(),
            "fov": view.fov,
        },
        "gain_db": _gains(streaming),
        "box_share": float(sides.prod(axis=1).mean()) if streaming.tiles else None,
    }


def _gains(streaming: Streaming) -> list[float | None]:
    gains = streaming.gains.astype(np.float64)
    errors = np.where(gains > 0, np.exp2((gains - GAIN_OF_ONE) / GAIN_STEPS), 0.0)
    sums = errors.sum(axis=2).mean(axis=0) if len(gains) else np.zeros(streaming.layers)
    return [float(10 * np.log10(total)) if total > 0 else None for total in sums]


def format_streaming(report: dict[str, Any] | None) -> str:
    """The description as lines for people, ending in a line break."""
    if report is None:
        return "streaming         none\n"
    gains = ", ".join("none" if gain is None else f"{gain:.1f}" for gain in report["gain_db"])
    lines = [
        f"streaming         {report['bytes']:,} bytes, {len(report['viewpoints'])} viewpoints",
        f"gains by layer    {gains} dB",
    ]
    if report["box_share"] is not None:
        lines.append(f"tight boxes       {100 * report['box_share']:.0f} % of their tiles")
    if report["view"] is not None:
        position, target = (" ".join(f"{x:.5g}" for x in report["view"][name]) for name in ("position", "target"))
        lines.append(f"view              from {position} to {target}")
    return "\n".join(lines) + "\n"
