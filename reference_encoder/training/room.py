"""Memory and disk that a run takes, and what there is of both: told before it begins."""

from __future__ import annotations

import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from reference_encoder.training.capture import Capture
from reference_encoder.training.options import LEAST_RESOLUTION
from scarfmt.errors import InvalidInput

_PROCESS = 450_000_000
"""Bytes of Python, torch and what they load."""
_A_PIXEL, _A_POINT = 250, 20_000
"""Bytes for a pixel of the largest photo, and for a point of the start, with the anchors that grow from it."""
_CGROUP = Path("/sys/fs/cgroup")


def needed_room(capture: Capture, scale: float = 1.0) -> tuple[int, int]:
    """Bytes of memory that a run takes, about, and of disk, for pixels, while it runs; photos scaled by so much."""
    areas = [scale * scale * photo.camera.width * photo.camera.height for photo in capture.photos]
    memory = _PROCESS + _A_PIXEL * max(areas) + _A_POINT * len(capture.points)
    return int(memory), int(3 * sum(areas))


def describe_room(capture: Capture) -> str:
    """What a run takes, for people."""
    memory, disk = needed_room(capture)
    return f"{_gigabytes(memory)} of memory and {_gigabytes(disk)} of disk"


def check_room(capture: Capture, folder: Path | None) -> None:
    """Refuse a capture that is too large for this machine.

    Args:
        folder: for pixels; None for where the system keeps temporary files.

    Raises:
        InvalidInput: ``input-options``, with what would fit.
    """
    memory, disk = free_memory(), free_disk(folder)

    def fits(scale: float) -> bool:
        needed = needed_room(capture, scale)
        return needed[0] <= memory and needed[1] <= disk

    if fits(1.0):
        return
    longest = max(max(photo.camera.width, photo.camera.height) for photo in capture.photos)
    size = next((size for size in range(longest, LEAST_RESOLUTION - 1, -1) if fits(size / longest)), None)
    advice = f"--resolution {size} would fit" if size else "use fewer points to start from, or a larger machine"
    there = f"{_gigabytes(memory)} and {_gigabytes(disk)}"
    message = f"training takes about {describe_room(capture)}, of which {there} are free: {advice}"
    raise InvalidInput("input-options", message, field="resolution")


def free_memory() -> float:
    """Bytes that the system can give without swapping, also where a container has less; infinite if nobody tells."""
    free = float("inf")
    with suppress(OSError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = 1024.0 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1])
    with suppress(OSError, ValueError, KeyError):
        # Pages of files can be had back.
        most = int((_CGROUP / "memory.max").read_text())
        held = dict(line.split() for line in (_CGROUP / "memory.stat").read_text().splitlines())
        free = min(free, most - int(held["anon"]))
    return free


def free_disk(folder: Path | None) -> float:
    """Bytes of the disk of a folder, which need not exist yet."""
    place = (folder or Path(tempfile.gettempdir())).absolute()
    while not place.exists():
        place = place.parent
    return float(shutil.disk_usage(place).free)


def _gigabytes(count: float) -> str:
    return f"{count / 1e9:.1f} GB"
