"""The report of `decode --stats`: the work of a decode, compared with the totals of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource
    from scarfmt.counters import Counters

_TOTALS = (("bytes", "bytes_read"), ("blocks", "blocks"), ("tiles", "tiles"), ("anchors", "anchors"))


def decode_stats(counters: Counters, seconds: float, engine: str, whole: dict[str, int]) -> dict[str, Any]:
    """A JSON-able description of a decode.

    Args:
        counters: counts of the decode.
        seconds: duration of the decode.
        engine: the decoder's name.
        whole: totals of the file.

    Returns:
        ``seconds``, ``engine``, ``decoded`` (:meth:`scarfmt.counters.Counters.report`) and ``file``, which is `whole`.
    """
    return {"seconds": seconds, "engine": engine, "decoded": counters.report(), "file": whole}


def whole_file(source: ByteSource) -> dict[str, int]:
    """The totals of a file, from its header: ``bytes``, ``tiles``, ``anchors`` and ``layers``."""
    from scarfmt.container.file import read_header

    header = read_header(source, allow_truncated=True)
    return {
        "bytes": header.file_length,
        "tiles": header.tile_count,
        "anchors": header.anchor_count,
        "layers": header.layer_count,
    }


def format_stats(stats: dict[str, Any]) -> str:
    """The report of :func:`decode_stats` for people, a line for each count."""
    decoded, whole = stats["decoded"], stats["file"]
    # The header does not give the number of blocks.
    rows = [(name, decoded[key], _share(decoded[key], whole.get(name))) for name, key in _TOTALS]
    rows[0] = (*rows[0][:2], f"{rows[0][2]}, in {decoded['reads']} reads")
    width = max(len(f"{count:,}") for _, count, _ in rows)
    lines = [f"{name:<17} {count:>{width},}  {note}".rstrip() for name, count, note in rows]
    lines.append(f"{'engine':<17} {stats['engine']:>{width}}")
    return "\n".join([*lines, f"{'seconds':<17} {stats['seconds']:>{width}.2f}"])


def _share(part: int, whole: int | None) -> str:
    if whole is None:
        return ""
    return f"of {whole:,} ({100 * part / whole:.1f} %)" if whole else f"of {whole:,}"
