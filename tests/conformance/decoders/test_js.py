"""The JavaScript decoder: its own tests, its Zstandard decompressor against the library, its command line."""

from __future__ import annotations

import json
import random
import re
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest
import zstandard

from conformance.generate import ROOT, VECTORS

FOLDER = ROOT / "decoders" / "js"
WORKED = VECTORS / "worked" / "input.scar"
REFUSED = 0xFFFFFFFF
MIB = 2**20

# Reads frames, each after its length; answers with contents, each after its length, or with REFUSED.
DECOMPRESS = """
import { readFileSync, writeSync } from "node:fs";
import { Refused } from "%s/errors.js";
import { decompress } from "%s/zstd.js";
const input = readFileSync(0);
const out = [];
for (let at = 0; at < input.length; ) {
  const length = input.readUInt32LE(at);
  const head = Buffer.alloc(4);
  try {
    const content = decompress(new Uint8Array(input.subarray(at + 4, at + 4 + length)), 2 ** 26);
    head.writeUInt32LE(content.length);
    out.push(head, content);
  } catch (error) {
    if (!(error instanceof Refused) || error.id !== "bad-zstd") throw error;
    head.writeUInt32LE(0xffffffff);
    out.push(head);
  }
  at += 4 + length;
}
const all = Buffer.concat(out);
for (let at = 0; at < all.length; ) at += writeSync(1, all, at);
"""


def find_node() -> str | None:
    """The command, where there is one of version 18 or later."""
    node = shutil.which("node")
    if node is None:
        return None
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    match = re.match(r"v(\d+)\.", version)
    return node if match and int(match[1]) >= 18 else None


NODE = find_node()
pytestmark = pytest.mark.skipif(NODE is None, reason="there is no node 18 or later on the path")


def run_node(*arguments: str, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    assert NODE is not None
    return subprocess.run([NODE, *arguments], input=data, capture_output=True, timeout=120, check=False)


def decompressed(frames: list[bytes]) -> list[bytes | None]:
    """Contents, None for a frame that is refused."""
    address = FOLDER.as_uri()
    data = b"".join(struct.pack("<I", len(frame)) + frame for frame in frames)
    answer = run_node("--input-type=module", "-e", DECOMPRESS % (address, address), data=data)
    assert answer.returncode == 0, answer.stderr.decode()
    contents: list[bytes | None] = []
    at = 0
    while at < len(answer.stdout):
        (length,) = struct.unpack_from("<I", answer.stdout, at)
        at += 4
        contents.append(None if length == REFUSED else answer.stdout[at : at + length])
        at += 0 if length == REFUSED else length
    assert len(contents) == len(frames)
    return contents


def compressed(content: bytes, level: int = 3, window_log: int | None = None, **options: Any) -> bytes:
    parameters = zstandard.ZstdCompressionParameters.from_level(level, source_size=len(content), **options)
    if window_log is not None or parameters.window_log > 23:
        options["window_log"] = window_log or 23
        parameters = zstandard.ZstdCompressionParameters.from_level(level, source_size=len(content), **options)
    return zstandard.ZstdCompressor(compression_params=parameters).compress(content)


def words(numbers: random.Random, size: int) -> bytes:
    vocabulary = [numbers.randbytes(numbers.randint(2, 12)) for _ in range(150)]
    return b"".join(numbers.choice(vocabulary) for _ in range(size // 2 + 1))[:size]


def skewed(numbers: random.Random, size: int) -> bytes:
    """Few long codes and many short ones: Huffman trees as deep as they come."""
    return bytes(numbers.choices(range(256), weights=[1 / (i + 1) ** 2 for i in range(256)], k=size))


def copies(numbers: random.Random, size: int) -> bytes:
    """Matches at all distances, among them the last ones again: repeated offsets."""
    out = bytearray(numbers.randbytes(4))
    while len(out) < size:
        distance = numbers.choice([1, 2, 3, 7, 64, 1000, numbers.randint(1, len(out))])
        for _ in range(numbers.randint(3, 90)):
            out.append(out[-min(distance, len(out))])
        out += numbers.randbytes(numbers.randint(0, 9))
    return bytes(out[:size])


def small_integers(numbers: random.Random, size: int) -> bytes:
    return b"".join(struct.pack("<h", int(numbers.gauss(0, 40))) for _ in range(size // 2 + 1))[:size]


@pytest.mark.parametrize("shape", [words, skewed, copies, small_integers], ids=lambda shape: str(shape.__name__))
def test_what_the_library_compresses_comes_back(shape: Any) -> None:
    """Blocks of all kinds: literals of one and four streams, trees and tables used again, repeated offsets."""
    numbers = random.Random(1)
    sizes = [1, 2, 5, 6, 7, 63, 255, 256, 257, 1000, 1024, 5000, 65_536, 131_071, 131_073, 300_000]
    contents = [shape(numbers, size) for size in sizes]
    levels = [-7, 1, 3, 6, 12, 19]
    frames = [compressed(content, level) for content in contents for level in levels]
    assert decompressed(frames) == [content for content in contents for _ in levels]


def test_plain_contents_come_back() -> None:
    """Blocks that are stored, and blocks of one byte repeated."""
    numbers = random.Random(2)
    contents = [b"a", bytes(1_000_000), numbers.randbytes(200_000), b"ab" * 70_000, bytes(range(256)) * 3]
    assert decompressed([compressed(content) for content in contents]) == contents


@pytest.mark.parametrize("window_log", [10, 15, 23])
def test_windows_up_to_8_mib_come_back(window_log: int) -> None:
    """Frames that are not a single segment, with blocks no larger than their window."""
    numbers = random.Random(3)
    content = copies(numbers, 200_000)
    frame = compressed(content, 9, window_log)
    assert decompressed([frame]) == [content]


def test_frames_that_section_5_8_forbids_are_refused() -> None:
    """R-5.8-1, R-5.8-3 and R-5.8-4, a rule each."""
    content = words(random.Random(4), 5000)
    good = compressed(content)
    without_size = zstandard.ZstdCompressor(write_content_size=False).compress(content)
    parameters = zstandard.ZstdCompressionParameters.from_level(3, window_log=24)
    wide = zstandard.ZstdCompressor(compression_params=parameters).compressobj(size=9 * MIB)
    frames = {
        "checksum": zstandard.ZstdCompressor(write_checksum=True).compress(content),
        "no content size": without_size,
        "empty": zstandard.ZstdCompressor().compress(b""),
        "window": wide.compress(bytes(9 * MIB)) + wide.flush(),
        "tail": good + b"\0",
        "two frames": good + good,
        "skippable": struct.pack("<II", 0x184D2A50, 4) + bytes(4),
        "skippable first": struct.pack("<II", 0x184D2A50, 4) + bytes(4) + good,
        "nothing": b"",
        "good": good,
    }
    found = dict(zip(frames, decompressed(list(frames.values())), strict=True))
    assert found.pop("good") == content
    assert all(found[name] is None for name in found), [name for name in found if found[name] is not None]


def test_cut_frames_are_refused() -> None:
    """No prefix of a frame is a frame, wherever it is cut."""
    numbers = random.Random(5)
    frames = [compressed(shape(numbers, 900), level) for shape in (words, skewed, copies) for level in (1, 19)]
    prefixes = [frame[:size] for frame in frames for size in range(0, len(frame), 3)]
    assert set(decompressed(prefixes)) == {None}


def test_damaged_frames_are_decompressed_or_refused() -> None:
    """Whatever the bytes, the content is as long as the frame states, and nothing else is thrown."""
    numbers = random.Random(6)
    frames = []
    for i in range(1500):
        frame = bytearray(compressed([words, skewed, copies][i % 3](numbers, 700), 1 + i % 19))
        frame[numbers.randrange(7, len(frame))] ^= 1 << numbers.randrange(8)
        frames.append(bytes(frame))
    assert {len(content) for content in decompressed(frames) if content is not None} <= {700}


def test_its_own_tests_pass() -> None:
    """CRC-32, SHA-256, varints, Rice codes, rANS, integer networks, the interface, damaged files."""
    found = run_node("--test", *(str(FOLDER / name) for name in ("units.test.mjs", "directory.test.mjs")))
    assert found.returncode == 0, found.stdout.decode()[-4000:]


def test_a_question_is_answered_with_one_object() -> None:
    """A refusal is an answer; a file that is not there is a failure."""
    cli = str(FOLDER / "cli.js")
    good = run_node(cli, str(WORKED), "--layers", "1", "--stage", "integers")
    assert good.returncode == 0
    assert json.loads(good.stdout)["stages"]["integers"]["arrays"]["class"]["shape"] == [2]
    refused = run_node(cli, str(FOLDER / "package.json"))
    assert refused.returncode == 0
    assert json.loads(refused.stdout)["refused"] == "bad-signature"
    assert run_node(cli, str(FOLDER / "no-such-file")).returncode != 0
    assert run_node(cli, str(WORKED), "--layers", "3").returncode != 0
    assert run_node(cli, str(WORKED), "--stage", "no-such-stage").returncode != 0


def test_a_session_answers_line_by_line(tmp_path: Path) -> None:
    """A line for each question, in order, also after a refusal."""
    cut = tmp_path / "cut.scar"
    cut.write_bytes(WORKED.read_bytes()[:300])
    questions = [
        {"file": str(WORKED), "layers": 0, "stage": "capabilities"},
        {"file": str(cut), "layers": 0, "stage": "all"},
        {"file": str(WORKED), "layers": 2, "stage": "values"},
        {"file": str(WORKED), "layers": 0, "stage": "metadata"},
    ]
    data = "".join(json.dumps(question) + "\n" for question in questions).encode()
    found = run_node(str(FOLDER / "cli.js"), "--session", data=data)
    assert found.returncode == 0, found.stderr.decode()
    capabilities, refused, values, metadata = [json.loads(line) for line in found.stdout.splitlines()]
    assert capabilities["capabilities"]["protocol"] == "scar-conformance 2"
    assert refused["refused"] == "truncated-header"
    assert values["stages"]["values"]["arrays"]["position"]["shape"] == [3, 3]
    assert metadata == {"stages": {"metadata": {"metadata": None}}}
