"""`make frozen`: SHA-256 of what the code makes, recorded once and compared afterwards.

A change that claims to change nothing keeps every digest. The record is of one machine, since encoding and training
round by its processor: record it before the change (``--record``), compare after it. Digests of decoding, truncating
and listing are the same everywhere.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED = REPOSITORY.parent / "shared" / "data"
EXAMPLE = REPOSITORY / "examples" / "plush-toys.ply"
SCENES = ("fruit-drops.ply", "flower-tile.ply", "plush-dog.ply")
PRESETS = ("default", "rvq", "paper")


def run(*arguments: str | Path) -> None:
    """Run one `scarfmt` command of this checkout, quietly; its failure is ours."""
    subprocess.run([sys.executable, "-m", "scarfmt", *map(str, arguments)], check=True, stderr=subprocess.PIPE)


def digest(path: Path) -> str:
    """SHA-256 of a file; of an archive of arrays, that of their names, types and bytes."""
    if path.suffix != ".npz":
        return hashlib.sha256(path.read_bytes()).hexdigest()
    total = hashlib.sha256()
    with np.load(path) as arrays:
        for name in sorted(arrays.files):
            array = arrays[name]
            total.update(f"{name} {array.dtype} {array.shape}".encode() + array.tobytes())
    return total.hexdigest()


def encodings(folder: Path) -> Iterator[tuple[str, str]]:
    """Files of the example and the shared scenes, in memory and range by range."""
    scenes = [EXAMPLE, *(path for name in SCENES if (path := SHARED / "splats" / name).exists())]
    for scene in scenes:
        for effort in ("1", "2"):
            out = folder / f"{scene.stem}-{effort}.scar"
            run("encode", scene, out, "--effort", effort, "--quiet")
            yield f"encode {scene.stem} --effort {effort}", digest(out)
    work = folder / "ranges.scar"
    run("encode", EXAMPLE, work, "--effort", "1", "--work", folder / "work", "--quiet")
    yield "encode plush-toys --work", digest(work)


def tools(folder: Path) -> Iterator[tuple[str, str]]:
    """What is made of an encoded file: layers, arrays, Gaussians."""
    file = folder / "plush-toys-2.scar"
    for layer in (1, 2):
        run("truncate", file, folder / f"cut-{layer}.scar", "--layers", str(layer))
        yield f"truncate --layers {layer}", digest(folder / f"cut-{layer}.scar")
    for suffix in ("ply", "npz"):
        run("decode", file, folder / f"out.{suffix}", "--quiet")
        yield f"decode {suffix}", digest(folder / f"out.{suffix}")


def trainings(folder: Path) -> Iterator[tuple[str, str]]:
    """Sixty iterations from photos with each preset."""
    photos = SHARED / "photos" / "plush-on-bed"
    for preset in PRESETS if photos.exists() else ():
        out = folder / f"{preset}.scar"
        settings = ("--iterations", "60", "--resolution", "120", "--seed", "0", "--quiet")
        run("train", photos, out, "--preset", preset, *settings)
        yield f"train --preset {preset}", digest(out)


def vectors(folder: Path) -> Iterator[tuple[str, str]]:
    """Arrays of every vector that decodes."""
    from scarfmt_conformance.archive import names, read

    import scarfmt
    from scarfmt.errors import ScarError

    for name in names():
        total = hashlib.sha256()
        try:
            decoded = scarfmt.decode(read(name), allow_truncated=True)
        except ScarError as error:
            total.update(error.refusal.encode())
        else:
            for part in ("tiles", "classes", "positions", "values", "indices", "slots"):
                _add(total, getattr(decoded, part))
        yield f"decode {name}", total.hexdigest()


def _add(total: hashlib._Hash, value: object) -> None:
    if isinstance(value, np.ndarray):
        total.update(f"{value.dtype} {value.shape}".encode() + value.tobytes())
    elif isinstance(value, dict):
        for key in sorted(value):
            _add(total, value[key])


def main() -> int:
    """0 if every digest is the recorded one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", type=Path, help="JSON of the digests")
    parser.add_argument("--record", dest="write", action="store_true", help="write the digests of today")
    parser.add_argument("--only", help="only keys that start so")
    options = parser.parse_args()
    found: dict[str, str] = {}
    parts = {"encode": encodings, "train": trainings, "vectors": vectors}
    with tempfile.TemporaryDirectory() as folder:
        for name, part in parts.items():
            if options.only in (None, name):
                found |= dict(part(Path(folder)))
                if name == "encode":
                    found |= dict(tools(Path(folder)))
    known = json.loads(options.record.read_text()) if options.record.exists() else {}
    if options.write:
        options.record.parent.mkdir(parents=True, exist_ok=True)
        options.record.write_text(json.dumps(known | found, indent=1, sort_keys=True))
        print(f"{len(found)} digests recorded")
        return 0
    wrong = sorted(key for key in found if found[key] != known.get(key))
    print("\n".join([*(f"differs: {key}" for key in wrong), f"{len(found) - len(wrong)} of {len(found)} as recorded"]))
    return 1 if wrong or not found else 0


if __name__ == "__main__":
    sys.exit(main())
