"""Truck of Tanks and Temples at full size on a CUDA machine whose commands may only run for some minutes.

    python -m benchmarks.truck CAPTURE                    a slice of nine minutes; exit code 75: call it again
    python -m benchmarks.truck CAPTURE --until-done       one slice after another, where a command may take its time
    python -m benchmarks.truck CAPTURE --size 5000000 --iterations 40000

CAPTURE is the folder of COLMAP with the 251 photos of 979x546 pixels that the published tables are of. Each call does
one thing: it goes on training, or, once the file is written, measures it against the photos that were held out and puts
the figures among those of `benchmarks.trained`. Checkpoints and the file lie in --folder.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.report import SCRATCH
from benchmarks.scenes import REPOSITORY
from reference_encoder.training.options import DEVICES
from scarfmt.cli.failures import UNFINISHED

SLICE_MINUTES, ITERATIONS = 9.0, 30_000

Start = Callable[[Sequence[str]], int]


def start(command: Sequence[str]) -> int:
    """Run a command from the repository's root; its exit status."""
    return subprocess.run(command, cwd=REPOSITORY, check=False).returncode


def training(said: argparse.Namespace, target: Path) -> list[str]:
    """The command that goes on training."""
    options = ["--iterations", str(said.iterations), "--device", said.device]
    options += ["--slice-minutes", str(said.slice_minutes)]
    options += [] if said.size is None else ["--size", str(said.size)]
    options += [] if said.resolution is None else ["--resolution", str(said.resolution)]
    program = [sys.executable, "-m", "scarfmt"]
    return [*program, "train", str(said.capture.absolute()), str(target), *options, "--run", f"{target}.run"]


def measuring(said: argparse.Namespace, target: Path) -> list[str]:
    """The command that measures."""
    options = [] if said.resolution is None else ["--resolution", str(said.resolution)]
    options += ["--lpips", *(str(path.absolute()) for path in said.lpips)] if said.lpips else []
    options += ["--no-write"] if said.no_write else []
    program = [sys.executable, "-m", "benchmarks.trained", "truck", str(said.capture.absolute())]
    return [*program, "--scar", f"{target.stem}={target}", *options]


def main(arguments: Sequence[str] | None = None, start: Start = start) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--iterations", type=int, default=ITERATIONS, help=f"iterations [default: {ITERATIONS:,}]")
    parser.add_argument("--size", type=int, help="target size of the file, bytes")
    parser.add_argument("--resolution", type=int, help="longest side of the photos, pixels [default: as they are]")
    parser.add_argument("--device", choices=DEVICES, default="cuda")
    parser.add_argument("--slice-minutes", type=float, default=SLICE_MINUTES, help=f"[default: {SLICE_MINUTES:g}]")
    parser.add_argument("--folder", type=Path, default=SCRATCH / "truck", help="folder for checkpoints and the file")
    parser.add_argument("--lpips", type=Path, nargs="+", default=[], metavar="FILE", help="weights for LPIPS")
    parser.add_argument("--until-done", action="store_true", help="run one slice after another")
    parser.add_argument("--no-write", action="store_true", help="print the table; JSON goes to build/bench/ only")
    said = parser.parse_args(arguments)
    size = "" if said.size is None else f", {said.size:,} bytes wanted"
    target = said.folder.absolute() / f"trained{size}.scar"
    target.parent.mkdir(parents=True, exist_ok=True)
    while True:
        if target.exists():
            return start(measuring(said, target))
        status = start(training(said, target))
        if status not in (0, UNFINISHED) or not said.until_done:
            return status or UNFINISHED


if __name__ == "__main__":
    sys.exit(main())
