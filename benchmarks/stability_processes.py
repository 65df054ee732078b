"""One set of files decoded in processes that compute differently: other kernels of the libraries, threads, hash seeds.

A library picks its inner loops by the processor it finds. Told to take those of older ones it adds in other orders,
with and without fused multiply-add: what another machine would do.
"""

from __future__ import annotations

import hashlib
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import child
from benchmarks.stability_files import Manner, decoding, digests

SEEDS = ("1", "2")
_BLAS = {"Prescott": "", "Nehalem": "", "Sandybridge": "", "Haswell": "X86_V3", "Zen": "X86_V3", "SkylakeX": "X86_V4"}
_TOLERANCE = 1e-5
TORCH = ("ATEN_CPU_CAPABILITY",)
"""Variables that only torch looks at: files are then decoded with it."""


def environments() -> dict[str, dict[str, str]]:
    """Variables of each kind of process, by name; those that this processor and these libraries know."""
    config: Any = np.show_config(mode="dicts")
    simd = config.get("SIMD Extensions", {})
    found, openblas = simd.get("found", []), "openblas" in config["Build Dependencies"]["blas"]["name"]
    out = {f"BLAS threads: {n}": {"OPENBLAS_NUM_THREADS": n, "OMP_NUM_THREADS": n} for n in ("1", "2", "4")}
    if openblas and platform.machine() == "x86_64":
        usable = [name for name, needs in _BLAS.items() if not needs or needs in found]
        out |= {f"BLAS kernels: {name}": {"OPENBLAS_CORETYPE": name} for name in usable}
    if found:
        out["NumPy: without SIMD beyond its baseline"] = {"NPY_DISABLE_CPU_FEATURES": " ".join(found)}
    for name in ("default", "avx2"):
        out[f"torch kernels: {name}"] = {"ATEN_CPU_CAPABILITY": name, "MKL_CBWR": "COMPATIBLE"}
    return out | {f"hash seed: {seed}": {"PYTHONHASHSEED": seed} for seed in SEEDS}


def decode_in(environment: Mapping[str, str], paths: Sequence[Path], real: Path | None) -> dict[str, Any]:
    """Decode files in a process with these variables; see :func:`decode_job`.

    Raises:
        subprocess.CalledProcessError: it failed, also where a library had none of the kernels it was told to take.
    """
    backend = "torch" if any(name in environment for name in TORCH) else "auto"
    job = {"paths": list(map(str, paths)), "real": None if real is None else str(real), "backend": backend}
    return child.run(environment, job="benchmarks.stability_processes:decode_job", **job)


def decode_job(job: dict[str, Any]) -> dict[str, Any]:
    """In a child.

    Returns:
        ``exact``, a digest of the exact arrays of each of ``paths``; and of ``real``, if it is given, ``single``, a
        digest of the activated values in float32, and ``worst``, the most they use of the tolerance (SPEC §9.5).
    """
    from functools import partial

    from scarfmt_conformance.reference.activated import activated_arrays

    from reference_decoder.backends import operations

    manner = Manner(make=partial(operations, job["backend"]))
    exact = {path: together(digests(decoding(Path(path), None, manner))) for path in job["paths"]}
    if job["real"] is None:
        return {"exact": exact}
    decoded = decoding(Path(job["real"]), None, manner).decoded
    single, double = (activated_arrays(decoded, dtype) for dtype in (np.float32, np.float64))
    used = [np.abs(single[k].astype(np.float64) - b) / np.maximum(np.abs(b), 1) for k, b in double.items()]
    worst = max(float(part.max(initial=0)) for part in used) / _TOLERANCE
    joined = hashlib.sha256(b"".join(array.tobytes() for array in single.values())).hexdigest()
    return {"exact": exact, "single": joined, "worst": worst}


def together(parts: Mapping[str, str]) -> str:
    """One digest of several."""
    return hashlib.sha256("".join(f"{name} {digest}\n" for name, digest in sorted(parts.items())).encode()).hexdigest()


def encode_in(environment: Mapping[str, str], scene: Path, count: int, effort: int) -> str:
    """SHA-256 of what the first `count` Gaussians of a scene are encoded to, in a process with these variables."""
    job = {"scene": str(scene), "count": count, "effort": effort}
    digest: str = child.run(environment, job="benchmarks.stability_processes:encode_job", **job)["sha256"]
    return digest


def encode_job(job: dict[str, Any]) -> dict[str, Any]:
    """In a child: ``sha256`` of the bytes."""
    from reference_encoder.encode import EncodeOptions, encode
    from scarfmt.formats import load
    from scarfmt.scene.gaussians import GaussianScene

    scene = load(job["scene"])
    assert isinstance(scene, GaussianScene)
    data = encode(scene.take(np.arange(min(job["count"], len(scene)))), EncodeOptions(41.0, job["effort"]))
    return {"sha256": hashlib.sha256(data).hexdigest()}


def encoder_environments() -> dict[str, dict[str, str]]:
    """Processes that have to write the same bytes."""
    threads = {n: {"OMP_NUM_THREADS": n, "OPENBLAS_NUM_THREADS": n, "NUMBA_NUM_THREADS": n} for n in ("1", "2")}
    return {
        "as usual": {},
        "again": {},
        **{f"{n} thread{'s' * (n > '1')}": variables for n, variables in threads.items()},
        **{f"hash seed {seed}": {"PYTHONHASHSEED": seed} for seed in SEEDS},
    }


def decoded_elsewhere(
    named: Mapping[str, Mapping[str, str]], paths: Sequence[Path], real: Path
) -> dict[str, dict[str, Any]]:
    """Decode in each environment, and in none under ``as usual``.

    Returns:
        For each ``files``, ``differ``, the names of those whose exact arrays are not as usual, ``same``, whether
        activated float32 values of `real` are, and ``worst`` (:func:`decode_job`); or ``failed``, the exit status of a
        process that ended badly.
    """
    usual = decode_in({}, paths, real)
    out = {"as usual": compared(usual, usual)}
    for name, environment in named.items():
        try:
            out[name] = compared(decode_in(environment, paths, real), usual)
        except subprocess.CalledProcessError as error:
            out[name] = {"failed": str(error.returncode)}
    return out


def compared(found: Mapping[str, Any], usual: Mapping[str, Any]) -> dict[str, Any]:
    """A process against the usual one."""
    differ = [Path(path).parent.name for path, digest in usual["exact"].items() if found["exact"][path] != digest]
    same = found["single"] == usual["single"]
    return {"files": len(usual["exact"]), "differ": differ, "same": same, "worst": found["worst"]}
