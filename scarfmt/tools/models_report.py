"""The report about the models that code the symbols of a file: static tables, predictors, index network (SPEC §10)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from scarfmt.coding.decoder_model import DECODER, MECHANISMS
from scarfmt.coding.models import SceneModels
from scarfmt.coding.reader import SceneReader
from scarfmt.container.file import Container
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.container.source import ByteSource
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor
from scarfmt.tools.inspection import read_metadata


def describe_models(source: ByteSource) -> dict[str, Any]:
    """A JSON-able description of the models of the layers present; reads the directory and all model blocks.

    Returns:
        ``context`` (passes, occupancies), ``predictors`` per channel, ``index_network`` or None, ``hash_grid`` or None,
        ``multiply_adds`` an anchor needs at most, ``blocks``: bytes per kind, and ``mechanisms``: what the encoder says
        that networks of the whole file save, and what they take by the model of a decoder.

    Raises:
        ScarError: for whatever makes the models or METADATA unusable.
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
        "mechanisms": _mechanisms(read_metadata(reader.container) or {}),
    }


def _mechanisms(metadata: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The bytes and times of each kind of network, from METADATA. Entries that no encoder writes are ignored.

    Returns:
        ``name``, ``saved_bytes``, ``multiply_adds``, ``ms``, and ``pays_below_mbit``: the bandwidth at which the bytes
        take as long as the network.
    """
    told = _object(metadata.get(MECHANISMS))
    found = [
        (f"predictors, {name}", record, DECODER.predictors_ns)
        for name, record in _object(told.get("predictors")).items()
    ]
    found += [("index network", told.get("index_network"), DECODER.index_network_ns)]
    return [_costed(name, record, ns) for name, record, ns in found if _is_record(record)]


def _object(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _is_record(record: Any) -> bool:
    values = [_object(record).get(name) for name in ("saved", "multiply_adds", "anchors")]
    return all(type(value) is int and abs(value) < 1 << 63 for value in values)


def _costed(name: str, record: Mapping[str, int], ns_of: Callable[[int, int], float]) -> dict[str, Any]:
    ns = ns_of(record["multiply_adds"], record["anchors"])
    return {
        "name": name,
        "saved_bytes": record["saved"],
        "multiply_adds": record["multiply_adds"],
        "ms": ns / 1e6,
        "pays_below_mbit": max(8e3 * record["saved"], 0) / ns if ns > 0 else 0.0,
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
        "head": "two-level" if network.heads[0].two_level else "flat",
        "activation_bits": network.activation_bits,
        "inputs": {
            "classes": network.inputs.classes,
            "own": network.inputs.own,
            "decoded": network.inputs.depths > 0,
            "latents": network.inputs.latents,
            "grid": network.inputs.grid,
        },
        "multiply_adds": network.multiply_adds(models.model.max_stages),
    }


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
    lines += [(found["name"], _worth_text(found)) for found in report["mechanisms"]]
    return "\n".join(f"{name:<17} {value}" for name, value in lines) + "\n"


def _worth_text(found: dict[str, Any]) -> str:
    return (
        f"{found['saved_bytes']:,} bytes saved in the whole file; {found['multiply_adds']:,} multiply-adds,"
        f" {found['ms']:,.1f} ms: pays below {found['pays_below_mbit']:,.3g} Mbit/s"
    )


def _network_text(network: dict[str, Any]) -> str:
    kind = f"GRU x{network['gru_layers']}" + (" with attention" if network["attention"] else "")
    layers = f"layers {network['layers'][0]}-{network['layers'][-1]}"
    sources = ", ".join(name for name in ("own", "decoded", "grid") if network["inputs"][name])
    return f"{kind}, H = {network['hidden']}, {network['head']} head, {layers}; sees class, {sources}"
