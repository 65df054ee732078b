"""The jobs of the benchmarks of scaling and of regions in processes of their own (`benchmarks.child`)."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.child import timed
from benchmarks.scaling_scenes import copies, read_scene, recut, summary, without_networks
from benchmarks.scenes import chosen

Job = dict[str, Any]


def encode(job: Job) -> dict[str, Any]:
    """Encode the `count` Gaussians of a scene nearest to its middle (None: all) into `out`.

    Also of a job: `scene`, `quality`, `effort`, and perhaps `tile_anchors`.
    """
    from reference_encoder.encode import encode as encoded
    from scarfmt.formats import load
    from scarfmt.formats.clean import clean
    from scarfmt.scene.gaussians import GaussianScene

    scene = chosen([job["scene"]])[0]
    source, _ = clean(load(scene.path), drop_invalid=True)
    if job.get("count") is not None and isinstance(source, GaussianScene):
        far = np.abs(source.positions - np.median(source.positions, axis=0)).max(axis=1)
        source = source.take(np.sort(np.argsort(far, kind="stable")[: job["count"]]))
    more = {name: job[name] for name in ("tile_anchors",) if name in job}
    options = scene.options(quality=job["quality"], effort=job["effort"], **more)
    wall, processor = time.perf_counter(), time.process_time()
    data = encoded(source, options)
    seconds, cpu = time.perf_counter() - wall, time.process_time() - processor
    Path(job["out"]).write_bytes(data)
    return {"seconds": seconds, "cpu": cpu, "bytes": len(data), "source_count": len(source)}


def rewrite(job: Job) -> dict[str, Any]:
    """Write the scene of `file` to `out`: without networks if `static`, in `tile_anchors`, `copies` times."""
    from reference_encoder.networks.file_costs import within_limits
    from scarfmt.coding.writer import write_scene
    from scarfmt.engines import best_engine

    scene = read_scene(job["file"])
    if job.get("static"):
        scene = without_networks(scene)
    if job.get("tile_anchors"):
        scene = recut(scene, job["tile_anchors"])
    scene = copies(scene, job.get("copies", 1))
    start = time.perf_counter()
    data = write_scene(scene, engine=best_engine())
    Path(job["out"]).write_bytes(data)
    seconds = time.perf_counter() - start
    return {"seconds": seconds, "bytes": len(data), "within_limits": within_limits(data), **summary(scene)}


def stream(job: Job) -> dict[str, Any]:
    """Decode `file` tile by tile and write it as a PLY to nowhere: no disk takes part."""
    from reference_decoder.stream_ply import export_ply

    with Path(os.devnull).open("wb") as nowhere:
        return timed(lambda: export_ply(job["file"], nowhere), job.get("runs", 1))


def arrays(job: Job) -> dict[str, Any]:
    """Decode the first `layers` layers (None: all) of `file` into arrays, activated."""
    from reference_decoder.decode import decode

    return timed(lambda: decode(job["file"], layers=job.get("layers")).scene, job.get("runs", 1))
