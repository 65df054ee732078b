"""METADATA that a reader of metadata refuses (SPEC §7.10): too many bytes, too deep, no JSON object."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.faults.limit_faults import long_last_block
from conformance.scenes.cases import Case, refuse
from conformance.scenes.container_scenes import root_file
from conformance.surgery.parts import block_added, change_rows, entry_with, remake

_METADATA = 64
_MAX_BYTES, _MAX_DEPTH = 1 << 24, 64

_NOT_JSON = (
    ("empty-object-twice", "METADATA of two objects", b"{}{}"),
    ("list", "METADATA that is a list", b"[1]"),
    ("nan", "METADATA that holds NaN", b'{"a":NaN}'),
    ("infinity", "METADATA that holds -Infinity", b'{"a":[-Infinity]}'),
    ("beyond-binary64", "METADATA with a number that rounds to an infinity", b'{"a":[{"b":1e999}]}'),
    ("beyond-binary64-unreported", "a number that rounds to an infinity, in a member whose name comes again",
     b'{"a":1e999,"a":2}'),
    ("whole-beyond-binary64", "METADATA with a whole number of 400 digits", b'{"a":-1' + 400 * b"0" + b"}"),
    ("whole-of-5000-digits", "a whole number of more digits than some interpreters convert",
     b'{"a":1' + 5000 * b"0" + b"}"),
    ("surrogate-high", "a string with the first half of a surrogate pair, then another escape", b'{"a":"\\ud83c\\n"}'),
    ("surrogate-low", "a string with the second half of a surrogate pair", b'{"a":["\\udf0d\\ud83c"]}'),
    ("surrogate-name", "a name with half a surrogate pair, as upper case hexadecimal", b'{"\\uD800":1}'),
    ("surrogate-unreported", "half a surrogate pair in a member whose name comes again",
     b'{"a":"\\udfff","a":"\\\\ud800"}'),
    ("utf-16", "METADATA in UTF-16", '{"a":1}'.encode("utf-16-le")),
    ("latin-1", "METADATA that is not UTF-8", b'{"a":"\xe9"}'),
    ("byte-order-mark", "METADATA that starts with a byte order mark", b"\xef\xbb\xbf{}"),
    ("comma", "METADATA with a comma after the last member", b'{"a":1,}'),
    ("blank", "METADATA of one blank", b" "),
)
_DEEP = (
    ("deep", "METADATA nested 65 deep, the object itself counted", b'{"a":' + 64 * b"[" + 64 * b"]" + b"}"),
    ("deep-objects", "METADATA of 3000 objects within each other", 3000 * b'{"a":' + b"1" + 3000 * b"}"),
    ("deep-not-json", "nested 65 deep and no JSON, as nothing is closed: nesting is checked first",
     b'{"]\\"]":' + 64 * b"["),
    ("deep-not-utf-8", "nested 65 deep after a byte that is not UTF-8: nesting is checked first",
     b'{"\xff":' + 64 * b"[" + 64 * b"]" + b"}"),
)  # fmt: skip


def metadata_faults() -> Iterator[Case]:
    """Each is refused by who reports metadata, and decoded by who does not look at it."""
    parts = long_last_block(root_file(), _MAX_BYTES + 1, kind=_METADATA, start=b"{}")
    yield refuse("limit-metadata", "16 MiB and a byte of METADATA, refused before it is read", "R-7.10-1 R-13.1-1",
                 "limit-metadata", parts.seal(), "metadata", parts.header["file_length"])
    for rows, rule, refusal in ((_NOT_JSON, "R-7.10-1", "bad-metadata"), (_DEEP, "R-7.10-3", "limit-metadata")):
        for name, purpose, text in rows:
            yield refuse(f"metadata-{name}", purpose, rule, refusal, _with_text(text), "metadata")
    wrong = change_rows(_with_text(b"{}"), entry_with(_METADATA, crc32=0))
    yield refuse("metadata-crc-zero", "METADATA whose CRC says 0", "R-5.6-1", "crc-mismatch", wrong, "metadata")


def _with_text(text: bytes) -> bytes:
    return remake(root_file(), block_added(text, kind=_METADATA, flags=2))
