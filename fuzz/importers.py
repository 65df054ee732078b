"""Damaged scene files of other formats through their importers, under limits of memory and time.

``python -m fuzz.campaign --kind importers`` changes what a small sound file says: a value of its JSON, a word of its
header, a number of its `.npy`, an opcode of its pickle, a byte; sizes and checksums of the container are made right
afterwards.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import pickle
import pickletools
import re
import struct
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from fuzz.case import Case
from reference_encoder import kept_values
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput, ScarError
from scarfmt.formats import load
from tests.formats import rad_files
from tests.formats.scene_files import EXAMPLES, anchor_arrays, glb, gltf, gltf_document, npy, sog_files, spz, zipped

Files = dict[str, bytes]
"""What lies in a folder, or in an archive, by name."""
Change = Callable[[bytes, Random], bytes]

_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 255, 65535, 1 << 31, (1 << 32) - 1, 1 << 53, 1 << 64, 1e30, 1e308, -0.5, 1e-320,
    "", "\0", "\ud800", "x" * 300, "../x", "/", ".", "a/b", "data:,", "\x1b[31m", [], {}, [[]], {"a": {}}, [0] * 40,
    float("inf"), float("nan"),
)  # fmt: skip
_WORDS = (b"0", b"-1", b"1", b"2", b"65536", b"4294967296", b"1e9", b"", b"\xff", *b"list float double uchar".split())
_OPCODES = b"(N}])t\x85\x86RbsuQ\x93"
_DEEP = 200


def change_json(text: bytes, dice: Random) -> bytes:
    """One to three values of a document replaced, removed, nested or taken from elsewhere in it."""
    document = json.loads(text)
    for _ in range(dice.choice((1, 1, 2, 3))):
        places = list(_places(document))
        if not places:
            break
        holder, key = dice.choice(places)
        how = dice.random()
        if how < 0.1:
            del holder[key]
        elif how < 0.25:
            other, place = dice.choice(places)
            holder[key] = json.loads(json.dumps(other[place]))
        elif how < 0.3:
            for _ in range(_DEEP):
                holder[key] = [holder[key]]
        elif how < 0.4 and isinstance(holder, list):
            holder.extend(json.loads(json.dumps(holder[:20])))
        elif isinstance(holder[key], int) and how < 0.7:
            holder[key] += dice.choice((-1, 1, 3, 100, 1 << 16))
        else:
            holder[key] = json.loads(json.dumps(dice.choice(_VALUES)))
    return json.dumps(document).encode()


def _places(value: Any) -> Any:
    for key, part in list(value.items()) if isinstance(value, dict) else list(enumerate(value))[:30]:
        yield value, key
        if isinstance(part, dict | list):
            yield from _places(part)


def change_bytes(data: bytes, dice: Random) -> bytes:
    """Some bytes replaced, removed or repeated, or the end lost; half of the changes near the beginning."""
    for _ in range(dice.choice((1, 1, 2, 4))):
        at = dice.randrange(max(1, min(len(data), 100) if dice.random() < 0.5 else len(data)))
        length = dice.choice((0, 1, 1, 2, 4, 8))
        piece = dice.choice((dice.randbytes(length), b"\0" * length, b"\xff" * length, data[at : at + length] * 2, b""))
        data = data[:at] + piece + data[at + length :]
    return data[: dice.randrange(len(data) + 1)] if dice.random() < 0.1 else data


def change_words(data: bytes, dice: Random) -> bytes:
    """A word of the text at the beginning, or a line of it."""
    head, end, rest = data.partition(b"end_header")
    if dice.random() < 0.3:
        lines = head.split(b"\n")
        at = dice.randrange(len(lines))
        lines[at : at + 1] = dice.choice(([], [lines[at]] * 2, [dice.choice(lines)], [lines[at], dice.choice(lines)]))
        return b"\n".join(lines) + end + rest
    word = dice.choice(list(re.finditer(rb"[^ \n]+", head)))
    return head[: word.start()] + dice.choice(_WORDS) + head[word.end() :] + end + rest


def change_npy(data: bytes, dice: Random) -> bytes:
    """A number or a mark of the header of a `.npy`."""
    head, body = data[:128], data[128:]
    word = dice.choice(list(re.finditer(rb"[0-9]+|[<>|=][a-z]|True|False", head)))
    new = dice.choice(b"0 -1 1 3 99999999999 <f8 |O >f4 True None (1,) <U9".split())
    return (head[: word.start()] + new + head[word.end() :])[:127].ljust(127) + b"\n" + body


def change_pickle(data: bytes, dice: Random) -> bytes:
    """Opcodes removed, repeated, exchanged or put in."""
    starts = [at for _, _, at in pickletools.genops(data) if at is not None]
    pieces = [data[a:b] for a, b in zip(starts, [*starts[1:], len(data)], strict=True)]
    for _ in range(dice.choice((1, 1, 2, 3, 6))):
        at = dice.randrange(len(pieces))
        opcode = dice.choice(pieces), bytes([dice.choice(_OPCODES)])
        short = b"h" + dice.randbytes(1), b"K" + dice.randbytes(1), b"\x8a\x08" + dice.randbytes(8)
        new = dice.choice((*opcode, *short, b"X\x03\0\0\0a\xed\x9f", b"G" + struct.pack(">d", 1e308)))
        pieces[at : at + 1] = dice.choice(([], [new], [new], [pieces[at], new], [pieces[at]] * 2, [new, pieces[at]]))
        pieces = pieces or [b"."]
    return b"".join(pieces)


def checkpoint() -> Files:
    """A dictionary of three networks as torch saves it, and its points; classes are named, not imported."""
    arrays = {name: array for name, array in anchor_arrays().items() if name.startswith("mlp_")}
    head, storages = b"\x80\x02}(", {}
    for number, (name, array) in enumerate(arrays.items()):
        key = str(number)
        storages[f"archive/data/{key}"] = array.astype("<f4").tobytes()
        size = b"(" + b"".join(_op(n) for n in array.shape) + b"t"
        stride = b"(" + b"".join(_op(int(s) // array.itemsize) for s in array.strides) + b"t"
        storage = b"(" + _op("storage") + b"ctorch\nFloatStorage\n" + _op(key) + _op("cpu") + _op(array.size) + b"tQ"
        tensor = b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + _op(0) + size + stride + b"\x89}tR"
        network, _, rest = name.partition(".")
        head += _op(f"{network.removeprefix('mlp_')}_mlp.{rest}") + tensor
    slots, width = anchor_arrays()["offset"].shape[1], anchor_arrays()["feat"].shape[1]
    names = ["x", "y", "z", *(f"f_anchor_feat_{n}" for n in range(width)), *(f"f_offset_{n}" for n in range(3 * slots))]
    names += [f"scale_{axis}" for axis in range(6)]
    properties = "".join(f"property float {name}\n" for name in names)
    head_of_points = f"ply\nformat binary_little_endian 1.0\nelement vertex 5\n{properties}end_header\n"
    points = head_of_points.encode() + np.ones((5, len(names)), "<f4").tobytes()
    return {"point_cloud.ply": points, "archive/data.pkl": head + b"u.", **storages}


def _op(value: str | int) -> bytes:
    if isinstance(value, int):
        return b"J" + struct.pack("<i", value)
    return pickle.dumps(value, 2)[2:].partition(b"q\0")[0].rstrip(b".")


_DOCUMENT, _BUFFER = gltf_document()
_SOG, _CHECKPOINT = sog_files(), checkpoint()
_NPZ = {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}
_LOD = json.dumps({"lodLevels": 1, "filenames": ["a/meta.json"], "environment": "a/meta.json", "tree": {"children": [
    {"lods": {"0": {"file": 0, "offset": 0, "count": 6}}}]}}).encode()  # fmt: skip


def _in_folder(files: Files, first: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            path = Path(folder) / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(data)
        load(Path(folder) / first)


def _change(files: Files, name: str, change: Change, dice: Random) -> Files:
    return {**files, name: change(files[name], dice)}


def _checkpoint(dice: Random) -> Callable[[], object]:
    change = dice.choice((change_pickle, change_pickle, change_bytes, change_words))
    files = _change(_CHECKPOINT, "point_cloud.ply" if change is change_words else "archive/data.pkl", change, dice)
    points = files.pop("point_cloud.ply")
    folder = {"point_cloud.ply": points, "checkpoints.pth": zipped(files)}
    return partial(_in_folder, folder, "point_cloud.ply")


def _sog(dice: Random) -> Callable[[], object]:
    name = "meta.json" if dice.random() < 0.8 else dice.choice(list(_SOG))
    files = _change(_SOG, name, change_json if name == "meta.json" else change_bytes, dice)
    if dice.random() < 0.9:
        return partial(load, zipped(files), format="sog")
    return partial(_in_folder, files, "meta.json")


def _stream(dice: Random) -> Callable[[], object]:
    files = {"lod-meta.json": change_json(_LOD, dice), **{f"a/{name}": data for name, data in _SOG.items()}}
    return partial(_in_folder, files, "lod-meta.json")


def _gltf(dice: Random) -> Callable[[], object]:
    how = dice.random()
    document = json.loads(change_json(json.dumps(_DOCUMENT).encode(), dice))
    if how < 0.5:
        return partial(load, glb(document, _BUFFER), format="gltf")
    if how < 0.9:
        return partial(load, change_json(gltf(_DOCUMENT, _BUFFER), dice), format="gltf")
    buffers = json.dumps(_DOCUMENT | {"buffers": [{"byteLength": len(_BUFFER), "uri": "b.bin"}]}).encode()
    files = {"a.gltf": change_json(buffers, dice), "b.bin": _BUFFER}
    return partial(load, zipped(files)) if how < 0.95 else partial(_in_folder, files, "a.gltf")


def _npz(dice: Random) -> Callable[[], object]:
    files = _change(_NPZ, dice.choice(list(_NPZ)), dice.choice((change_npy, change_npy, change_bytes)), dice)
    return partial(load, zipped(files), format="anchor-npz")


def _archive(dice: Random) -> Callable[[], object]:
    """A directory of a ZIP that lies."""
    name, files = dice.choice((("sog", _SOG), ("anchor-npz", _NPZ)))
    archive = zipped(files, dice.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))
    return partial(load, change_bytes(archive, dice), format=name)


def _spz(dice: Random) -> Callable[[], object]:
    data = gzip.decompress(spz(dice.choice((1, 2, 3))))
    members = gzip.compress(data[:40], 1, mtime=0) + gzip.compress(data[40:], 1, mtime=0)
    data = change_bytes(members, dice) if dice.random() < 0.3 else gzip.compress(change_bytes(data, dice), 1, mtime=0)
    return partial(load, data, format="spz")


def _supersplat(dice: Random) -> Callable[[], object]:
    splat = {"position": [0, 1, 0], "rotation": [0, 0, 1, 0], "scale": [1, 1, 2], "tintClr": [1, 1, 1, 1]}
    document = json.dumps({"version": 0, "splats": [splat]}).encode()
    return partial(load, zipped({"document.json": change_json(document, dice), "splat_0.ply": EXAMPLES["ply"]}))


def _rad(dice: Random) -> Callable[[], object]:
    """The JSON of the head, or of a chunk."""
    if dice.random() < 0.4:
        return partial(load, _change_head(EXAMPLES["rad"], dice), format="rad")
    properties = rad_files.plain(3, child_count=rad_files.entry("child_count", "u16", b"\2\0\0\0\0\0"))
    data = _change_head(rad_files.chunk(0, 3, properties), dice)
    return partial(load, rad_files.file([data], count=3), format="rad")


def _change_head(data: bytes, dice: Random) -> bytes:
    end = 8 + int.from_bytes(data[4:8], "little")
    text = change_json(data[8:end], dice)
    return data[:4] + struct.pack("<I", len(text)) + text + bytes(-len(text) % 8) + data[end + -end % 8 :]


def _bytes(dice: Random) -> Callable[[], object]:
    name = dice.choice(list(EXAMPLES))
    data = change_bytes(EXAMPLES[name], dice)
    return partial(load, data, format=name.split()[0]) if dice.random() < 0.6 else partial(load, data)


def _ply(dice: Random) -> Callable[[], object]:
    name = dice.choice(("ply", "ply ascii", "compressed-ply"))
    return partial(load, change_words(EXAMPLES[name], dice), format=name.split()[0])


_TABLE = SymbolTable(np.arange(2), np.ones(2, np.int64))
_KEPT = b"".join(kept_values.pack({"a": (1, np.zeros((2, 3))), "b": [_TABLE, b"x"]}))


def _work(dice: Random) -> Callable[[], object]:
    """A file of a work directory, or a checkpoint, its digest right."""
    length = int.from_bytes(_KEPT[40:48], "little")
    text = change_json(_KEPT[48 : 48 + length], dice)
    content = len(text).to_bytes(8, "little") + text + _KEPT[48 + length :]
    return partial(_unpack, _KEPT[:8] + hashlib.sha256(content).digest() + content)


def _unpack(data: bytes) -> None:
    try:
        kept_values.unpack(data)
    except ValueError as error:
        raise InvalidInput("work-damaged", str(error)) from error


_KINDS = (_checkpoint, _sog, _stream, _gltf, _npz, _archive, _spz, _supersplat, _rad, _bytes, _ply, _work)
FORMATS = {made.__name__[1:]: made for made in _KINDS}
"""A mutant of each kind, by its name: what reads it."""


def prepare(seed: int) -> Callable[[int], Case]:
    """The importers on mutants of their examples."""
    return partial(case, seed)


def case(seed: int, number: int) -> Case:
    """A mutant, and what reads it."""
    dice = Random(seed << 40 | number)
    kind = dice.choice(list(FORMATS))
    return Case(f"{number} {kind}", b"", partial(examine, kind, FORMATS[kind](dice)))


def examine(kind: str, read: Callable[[], object]) -> tuple[str, None]:
    """Read a mutant: its kind, and the refusal, or that it was read."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            read()
        except ScarError as error:
            return f"{kind} {error.refusal}", None
    return f"{kind} read", None
