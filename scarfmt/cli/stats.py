"""What `decode --stats` reports: the work of a decode, beside what the whole file holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scarfmt.container.source import ByteSource
    from scarfmt.counters import Counters

_TOTALS = (("bytes", "bytes_read"), ("blocks", "blocks"), ("tiles", "tiles"), ("anchors", "anchors"))
_DETAILS = {"symbols": "symbols_by_coding", "multiply_adds": "multiply_adds_by_part"}


def decode_stats(source: ByteSource, counters: Counters, seconds: float, engine: str) -> dict[str, Any]:
    """A JSON-able description of a decode.

    Args:
        source: what was decoded from; all it transferred so far counts.
        counters: of the decode.
        seconds: it took.
        engine: that computed.

    Returns:
        ``seconds``, ``engine``, ``decoded`` (:meth:`scarfmt.counters.Counters.report`), and of the ``file``
        the ``bytes``, ``tiles``, ``anchors`` and ``layers``, which its header tells.
    """
    from scarfmt.container.file import read_header

    counters.bytes_read, counters.reads = source.bytes_read, source.reads
    decoded = counters.report()
    header = read_header(source, allow_truncated=True)
    whole = {
        "bytes": header.file_length,
        "tiles": header.tile_count,
        "anchors": header.anchor_count,
        "layers": header.layer_count,
    }
    return {"seconds": seconds, "engine": engine, "decoded": decoded, "file": whole}


def format_stats(stats: dict[str, Any]) -> str:
    """The report of :func:`decode_stats` for people, a line for each count."""
    decoded, whole = stats["decoded"], stats["file"]
    # How many blocks a file has its header does not tell.
    rows = [(name, decoded[key], _share(decoded[key], whole[name]) if name in whole else "") for name, key in _TOTALS]
    for name, key in _DETAILS.items():
        rows.append((name.replace("_", "-"), decoded[name], ""))
        rows += [(f"  {part.replace('_', ' ')}", count, "") for part, count in decoded[key].items() if count]
    rows[0] = (*rows[0][:2], f"{rows[0][2]}, in {decoded['reads']} reads")
    width = max(len(f"{count:,}") for _, count, _ in rows)
    lines = [f"{name:<17} {count:>{width},}  {note}".rstrip() for name, count, note in rows]
    lines.append(f"{'engine':<17} {stats['engine']:>{width}}")
    return "\n".join([*lines, f"{'seconds':<17} {stats['seconds']:>{width}.2f}"]) + "\n"


def _share(part: int, whole: int) -> str:
    return f"of {whole:,} ({100 * part / whole:.1f} %)" if whole else f"of {whole:,}"
