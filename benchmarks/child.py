"""One job in a process of its own, so that its peak memory is its own: prints a JSON object on stdout.

    python -m benchmarks.child '{"job": "encode", "scene": "flowers", "quality": 45, "effort": 2, "out": "f.scar"}'
    python -m benchmarks.child '{"job": "decode", "file": "f.scar", "threads": 2}'
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.scenes import REPOSITORY

DECODE_RUNS = 3


def run(**job: Any) -> dict[str, Any]:
    """Do `job` in a new process: what it reports, with ``peak_bytes`` of that process.

    Raises:
        subprocess.CalledProcessError: it failed; its messages went to stderr.
    """
    command = [sys.executable, "-m", "benchmarks.child", json.dumps(job)]
    done = subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.PIPE, check=True)
    return dict(json.loads(done.stdout))


def peak_bytes() -> int:
    """Most memory this process ever held, bytes.

    Not `ru_maxrss` where Linux tells better: that one survives exec, so a child starts with its parent's peak.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return int(status.read_text(encoding="utf-8").split("VmHWM:")[1].split()[0]) * 1024
    import resource

    # Bytes on macOS, the one other system this runs on.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _encode(job: dict[str, Any]) -> dict[str, Any]:
    from benchmarks.scenes import chosen
    from reference_encoder.clean import clean
    from reference_encoder.encode import EncodeOptions, encode
    from reference_encoder.importers import load

    scene = chosen([job["scene"]])[0]
    source, _ = clean(load(scene.path), drop_invalid=True)
    options = EncodeOptions(
        quality=job["quality"], effort=job["effort"], frame=scene.frame, cameras=scene.known_cameras()
    )
    start = time.perf_counter()
    data = encode(source, options)
    seconds = time.perf_counter() - start
    Path(job["out"]).write_bytes(data)
    return {"seconds": seconds, "bytes": len(data)}


def _decode(job: dict[str, Any]) -> dict[str, Any]:
    from reference_decoder.decode import decode

    seconds = []
    for _ in range(DECODE_RUNS):
        start = time.perf_counter()
        scene = decode(job["file"], threads=job["threads"], layers=job.get("layers")).scene
        seconds.append(time.perf_counter() - start)
        count = len(scene)
        # Two results at once would count as the peak of one.
        del scene
    return {"seconds": min(seconds), "count": count}


def _export(job: dict[str, Any]) -> dict[str, Any]:
    from reference_decoder.stream_ply import export_ply

    start = time.perf_counter()
    count = export_ply(job["file"], job["out"], force=True)
    return {"seconds": time.perf_counter() - start, "count": count}


def _inspect(job: dict[str, Any]) -> dict[str, Any]:
    from scarfmt.inspection import inspect
    from scarfmt.source import open_source

    start = time.perf_counter()
    with open_source(job["file"]) as source:
        inspect(source)
        return {"seconds": time.perf_counter() - start, "bytes_read": source.bytes_read, "reads": source.reads}


JOBS = {"encode": _encode, "decode": _decode, "export": _export, "inspect": _inspect}


def main() -> None:
    job = json.loads(sys.argv[1])
    print(json.dumps({**JOBS[job["job"]](job), "peak_bytes": peak_bytes()}))


if __name__ == "__main__":
    main()
