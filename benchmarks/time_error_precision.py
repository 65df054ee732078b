"""The costs and gains of precision: bits of the index network, of positions, and steps of attribute values.

The encoder has no options for the first two: here its own constants are replaced while it runs. Positions and steps
are measured on files with static tables (effort 1), networks on the indices of one scene.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import child
from benchmarks.child import note_path
from benchmarks.encoded import encoded, kept_path
from benchmarks.gain import hardly_trained, quantised
from benchmarks.quality import distortion
from benchmarks.scenes import Scene, chosen
from reference_decoder.decode import decode
from reference_encoder.decide import lattice
from reference_encoder.encode import encode
from reference_encoder.networks import affordable, defaults
from reference_encoder.networks.candidates import with_index_network
from reference_encoder.networks.file_costs import index_bytes
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.tuning import CELL_FACTOR
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import silent, write_scene
from scarfmt.container.directory import local_bits
from scarfmt.container.source import open_source
from scarfmt.engines import best_engine
from scarfmt.tools.inspection import inspect

QUALITY = 41.0
WEIGHT_BITS = (4, 5, 6, 8)
ACTIVATION_BITS = (8, 10, 12)
POSITION_BITS = (-2, -1, 0, 1, 2)
"""Added to the bits of an axis that the encoder chooses for a tile."""
STEP_QUALITIES = (35.0, 38.0, 41.0, 44.0, 47.0, 50.0)
SHORT_WEIGHT_BITS: tuple[int, ...] = (4,)
SHORT_ACTIVATION_BITS: tuple[int, ...] = ()
SHORT_POSITION_BITS = (0, 1)
Record = dict[str, Any]
Row = dict[str, Any]


@contextmanager
def network_bits(weight: int | None = None, activation: int | None = None) -> Iterator[list[NetworkShape]]:
    """Inside, the encoder makes index networks of so many bits; yields their shapes, to be filled."""
    whole = defaults.shape_for
    made: list[NetworkShape] = []

    def shape_for(indices: int, dimension: int, attention: bool = False) -> NetworkShape:
        shape = whole(indices, dimension, attention)
        if weight is not None:
            limit = max(shape.weight_limit, (1 << (weight - 1)) - 1)
            shape = replace(shape, weight_bits=weight, weight_limit=limit)
        made.append(shape if activation is None else replace(shape, activation_bits=activation))
        return made[-1]

    with mock.patch.object(affordable, "shape_for", shape_for):
        yield made


@contextmanager
def position_bits(more: int) -> Iterator[None]:
    """Inside, the encoder's lattices have `more` bits an axis than it would choose."""
    with mock.patch.object(lattice, "CELL_FACTOR", CELL_FACTOR * 2.0**-more):
        yield


def networks(job: Record) -> Record:
    """Child job: bytes of a scene's indices and seconds of training by bits of weights, then of activations."""
    scene = chosen([job["scene"]])[0]
    options = scene.options(quality=QUALITY, effort=job["effort"], archive=True)
    plain = quantised(scene, options)
    rows: list[Row] = []
    variants = [(bits, None) for bits in job["weight_bits"]] + [(None, bits) for bits in job["activation_bits"]]
    for weight, activation in variants:
        began = time.perf_counter()
        with ExitStack() as stack:
            stack.enter_context(hardly_trained() if job["effort"] == 1 else nullcontext())
            made = stack.enter_context(network_bits(weight, activation))
            learned = with_index_network(plain, options, silent)
        if learned is None:
            return {"rows": []}
        path = Path(job["paths"][len(rows)])
        path.write_bytes(write_scene(learned.scene, engine=best_engine()))
        seconds = time.perf_counter() - began
        shape = made[-1]
        bits = {"weight_bits": shape.weight_bits, "activation_bits": shape.activation_bits}
        swept = "weights" if activation is None else "activations"
        rows.append({**bits, "swept": swept, "index_bytes": index_bytes(path.read_bytes()), "train_seconds": seconds})
    return {"rows": rows}


def measure_networks(
    scene: Scene, effort: int, rounds: int, weights: Sequence[int], activations: Sequence[int]
) -> list[Row]:
    """Bytes of all indices and decode seconds of files that differ in the bits of their index network alone."""
    names = [f"weights {bits}" for bits in weights] + [f"activations {bits}" for bits in activations]
    paths = [kept_path(scene, f"network {name} e{effort}") for name in names]
    note = note_path(kept_path(scene, f"networks {' '.join(names)} e{effort}"))
    if not (note.exists() and all(path.exists() for path in paths)):
        made = child.run(
            job="benchmarks.time_error_precision:networks",
            scene=scene.name,
            effort=effort,
            weight_bits=list(weights),
            activation_bits=list(activations),
            paths=[str(path) for path in paths],
        )
        note.write_text(json.dumps(made["rows"]), encoding="utf-8")
    rows = json.loads(note.read_text(encoding="utf-8"))
    # No rows: a scene without indices has no network.
    jobs = {name: _decoding(path) for name, path, _ in zip(names, paths, rows, strict=False)}
    times = child.in_turns(jobs, rounds)
    return [{**row, "decode": times[name]} for name, row in zip(names, rows, strict=False)]


def _decoding(path: Path) -> child.Job:
    return {"job": "decode", "file": str(path), "threads": 1}


def encode_moved(job: Record) -> Record:
    """Child job: encode a scene at effort 1 with more or fewer bits of positions, and else at the same lambda."""
    scene = chosen([job["scene"]])[0]
    with position_bits(job["more"]):
        options = scene.options(quality=job["quality"], effort=1, corrections=0)
        data = encode(_source(scene), options)
    Path(job["out"]).write_bytes(data)
    return {}


def _source(scene: Scene) -> Any:
    from scarfmt.formats import load
    from scarfmt.formats.clean import clean

    return clean(load(scene.path), drop_invalid=True)[0]


def moved_path(scene: Scene, quality: float, more: int) -> Path:
    """The file of a scene with `more` bits of positions than the encoder would choose."""
    path = kept_path(scene, f"positions {more:+d} q{quality:g}")
    if not path.exists():
        job = "benchmarks.time_error_precision:encode_moved"
        child.run(job=job, scene=scene.name, quality=quality, more=more, out=str(path))
    return path


def measure_positions(scene: Scene, quality: float, rounds: int, steps: Sequence[int]) -> list[Row]:
    """Bytes, error and time by bits of positions."""
    return _measured(scene, {str(more): moved_path(scene, quality, more) for more in steps}, rounds, _position_facts)


def measure_steps(scene: Scene, rounds: int, qualities: Sequence[float]) -> list[Row]:
    """Bytes, error and time by the steps that values receive, which the quality asked for decides."""
    paths = {f"{quality:g}": Path(encoded(scene, quality, 1)["path"]) for quality in qualities}
    return _measured(scene, paths, rounds, _step_facts)


def _measured(scene: Scene, paths: dict[str, Path], rounds: int, facts: Callable[[Path], Row]) -> list[Row]:
    times = child.in_turns({name: _decoding(path) for name, path in paths.items()}, rounds)
    rows = []
    for name, path in paths.items():
        last = distortion(scene, path)["layers"][-1]
        found = {"bytes": path.stat().st_size, "psnr_db": last["psnr_db"], "ssim": last["ssim"]}
        rows.append({"value": float(name), **found, **facts(path), "decode": times[name]})
    return rows


def _position_facts(path: Path) -> Row:
    """Mean bits of an axis in a tile, over anchors, and bits an anchor of positions and their residuals."""
    with open_source(path) as source:
        reader = SceneReader(source, engine=best_engine())
        entries = [reader.container.tile_entries(tile, reader.layers) for tile in range(reader.header.tile_count)]
        anchors = [sum(entry.count for entry in row if entry) for row in entries]
        bits = [local_bits(reader.header.fields, tile) for tile in reader.container.tiles]
        layers = inspect(source)["layers"]
    kinds = "positions", "position_residual"
    sizes = {kind: sum(layer["streams"].get(kind, 0) for layer in layers) for kind in kinds}
    each = {f"{kind}_bits": 8 * size / sum(anchors) for kind, size in sizes.items()}
    return {"axis_bits": float(np.average(bits, weights=anchors)), **each}


def _step_facts(path: Path) -> Row:
    """Mean ternary steps a value has received, by channel, over all anchors of the file."""
    decoded = decode(path)
    model = decoded.models.model
    steps = np.array(model.layers[-1].steps)[decoded.classes].mean(axis=0)
    return {"steps": {c.stream.name.lower(): float(s) for c, s in zip(model.channels, steps, strict=True)}}
