"""Reports about models that code symbols (SPEC §10), and about the STREAMING block (SPEC §7.13)."""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.blocks.streaming import read_streaming
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import SceneReader
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import ByteSource
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor


def describe_models(source: ByteSource) -> dict[str, Any]:
    """A JSON-able description of the models of the layers present; reads the directory and all model blocks.

    Returns:
        ``context`` (passes, occupancies), ``predictors`` per channel, ``index_network`` or None, ``hash_grid`` or None,
        ``multiply_adds`` an anchor needs at most, and ``blocks``: bytes per kind.

    Raises:
        ScarError: for whatever makes the models unusable.
    """
    reader = SceneReader(source, allow_truncated=True)
    models = reader.models()
    predictors = models.predictors[-1]
    products = sum(predictor.multiply_adds for predictor in predictors.values())
    if models.network is not None:
        products += models.network.multiply_adds(models.model.max_stages)
    return {
        "context": {
            "passes": models.model.context.passes_log2 + 1,
            "occupancies": list(models.model.context.occupancies),
        },
        "predictors": _predictors(predictors),
        "index_network": None if models.network is None else _network(models, models.network),
        "hash_grid": None if (g := models.grid) is None else {"levels": len(g.levels), "features": g.width},
        "multiply_adds": products,
        "blocks": _block_bytes(reader.container),
    }


def _predictors(predictors: dict[tuple[int, int, int], Predictor]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for stream, _, _ in predictors:
        name = Stream(stream).name.lower()
        counts[name] = counts.get(name, 0) + 1
    return counts


def _network(models: SceneModels, network: IndexNetwork) -> dict[str, Any]:
    layers = [number for number, row in enumerate(models.model.layers, start=1) if row.neural]
    return {
        "layers": layers,
        "hidden": network.hidden,
        "gru_layers": len(network.gru),
        "attention": network.attention is not None,
        "activation_bits": network.activation_bits,
        "inputs": {
            "classes": network.inputs.classes,
            "own": network.inputs.own,
            "decoded": _sees_decoded(network),
            "latents": network.inputs.latents,
            "grid": network.inputs.grid,
        },
        "multiply_adds": network.multiply_adds(models.model.max_stages),
    }


def _sees_decoded(network: IndexNetwork) -> bool:
    """Whether any weight of the decoded context is other than 0; all are in the paper's network."""
    inputs, weights = network.inputs, network.embed[0].weights
    first = inputs.classes + (inputs.attributes if inputs.own else 0)
    return bool(weights[:, first : inputs.width - inputs.grid].any())


def _block_bytes(container: Container) -> dict[str, int]:
    sizes: dict[str, int] = {}
    for entry in container.models:
        if entry.kind < BlockKind.TILE and container.is_available(entry):
            name = BlockKind(entry.kind).name.lower()
            sizes[name] = sizes.get(name, 0) + entry.length
    return sizes


def format_models(report: dict[str, Any]) -> str:
    """The description made by :func:`describe_models` for people, ending in a line break."""
    context, network, grid = report["context"], report["index_network"], report["hash_grid"]
    lines = [("model blocks", ", ".join(f"{name} {size:,} bytes" for name, size in report["blocks"].items()))]
    if context["occupancies"]:
        cells = ", ".join(map(str, context["occupancies"]))
        lines.append(("context", f"{context['passes']} passes, cells of about {cells} anchors"))
    counts = ", ".join(f"{name} {count}" for name, count in report["predictors"].items())
    lines.append(("predictors", counts or "none: static contexts"))
    lines.append(("index network", "none: static tables" if network is None else _network_text(network)))
    if network is not None:
        levels = "none" if grid is None else f"{grid['levels']} levels, {grid['features']} features"
        lines.append(("hash grid", levels))
    lines.append(("multiply-adds", f"at most {report['multiply_adds']:,} an anchor"))
    return "\n".join(f"{name:<17} {value}" for name, value in lines) + "\n"


def _network_text(network: dict[str, Any]) -> str:
    kind = f"GRU x{network['gru_layers']}" + (" with attention" if network["attention"] else "")
    layers = f"layers {network['layers'][0]}-{network['layers'][-1]}"
    sources = ", ".join(name for name in ("own", "decoded", "grid") if network["inputs"][name])
    return f"{kind}, H = {network['hidden']}, {layers}; sees class, {sources}"


def describe_streaming(container: Container) -> dict[str, Any] | None:
    """A JSON-able description; None where there is no such block, or a cut source does not reach it.

    Returns:
        ``bytes``; ``view`` to begin with as ``position``, ``target``, ``up`` and ``fov`` (radians), or None;
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
        "view": None
        if view is None
        else {
            "position": view.position.tolist(),
            "target": view.target.tolist(),
            "up": view.up.tolist(),
            "fov": view.fov,
        },
        "box_share": float(sides.prod(axis=1).mean()) if streaming.tiles else None,
    }


def format_streaming(report: dict[str, Any] | None) -> str:
    """The description as lines for people, ending in a line break."""
    if report is None:
        return "streaming         none\n"
    lines = [f"streaming         {report['bytes']:,} bytes"]
    if report["box_share"] is not None:
        lines.append(f"tight boxes       {100 * report['box_share']:.0f} % of their tiles")
    if report["view"] is not None:
        position, target = (" ".join(f"{x:.5g}" for x in report["view"][name]) for name in ("position", "target"))
        lines.append(f"view              from {position} to {target}")
    return "\n".join(lines) + "\n"
