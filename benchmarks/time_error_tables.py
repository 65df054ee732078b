"""The tables of docs/time-and-error.md, from what `benchmarks.time_error` measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.gain import STATIC
from benchmarks.report import table
from benchmarks.time_error_files import at_equal_error
from benchmarks.time_error_limit import PARTS

Record = dict[str, Any]


def layers_text(records: Sequence[Record]) -> str:
    """Bytes, error and decode seconds of every prefix of layers, and other reads of the whole file."""
    head = ["scene", "quality", "layers", "bytes", "PSNR dB", "SSIM", "1 thread, s", "2 threads, s", "peak MiB"]
    rows, others = [], []
    for record in records:
        name = [record["scene"], f"{record['quality']:g}"]
        for number, layer in enumerate(record["layers"], start=1):
            one, two = layer["decode"]["1"], layer["decode"]["2"]
            error = [f"{layer['bytes']:,}", f"{layer['psnr_db']:.2f}", f"{layer['ssim']:.4f}"]
            rows.append([*name, str(number), *error, seconds(one), seconds(two), mebibytes(two["peak_bytes"])])
        export, told = record["other"]["export"], record["other"]["inspect"]
        took = [f"{export['seconds']:.2f}", mebibytes(export["peak_bytes"])]
        others.append([*name, *took, f"{told['seconds'] * 1e3:.1f}", f"{told['bytes_read']:,} in {told['reads']}"])
    other_head = ["scene", "quality", "to PLY by tiles, s", "peak MiB", "inspect, ms", "bytes in requests"]
    return f"{table(head, rows)}\nOther reads of the same files:\n\n{table(other_head, others)}"


def seconds(times: Record) -> str:
    """Median and least."""
    return f"{times['median']:.3f} ({times['min']:.3f})"


def mebibytes(size: float) -> str:
    """Whole MiB."""
    return f"{size / 2**20:,.0f}"


def efforts_text(records: Sequence[Record]) -> str:
    """Encode seconds and memory, and bytes at equal error, by effort."""
    head = ["scene", "effort", "quality", "encode s", "peak MiB", "bytes", "PSNR dB", "bytes at equal PSNR", ""]
    rows = []
    for record in records:
        goal, equal = at_equal_error(record["runs"])
        base = next(iter(equal.values()))
        seen: set[int] = set()
        for run in record["runs"]:
            cells = [record["scene"], str(run["effort"]), f"{run['quality']:g}", f"{run['seconds']:.1f}"]
            cells += [mebibytes(run["peak_bytes"]), f"{run['bytes']:,}", f"{run['psnr_db']:.2f}"]
            size = equal[run["effort"]]
            told = ["", ""] if run["effort"] in seen else [f"{size:,.0f} at {goal:.2f} dB", change(size, base)]
            seen.add(run["effort"])
            rows.append([*cells, *told])
    return table(head, rows)


def change(now: float, before: float) -> str:
    """In percent."""
    return f"{100 * (now / before - 1):+.1f} %"


def precision_text(records: Sequence[Record]) -> str:
    """Three sweeps."""
    parts = [("Bits of the index network", _networks), ("Bits of positions", _positions), ("Steps of values", _steps)]
    return "\n\n".join(f"### {title}\n\n{draw(records)}".rstrip() for title, draw in parts)


def _networks(records: Sequence[Record]) -> str:
    head = ["scene", "swept", "weight bits", "activation bits", "all indices, bytes", "", "decode s", "train s"]
    rows = []
    for record in records:
        least = min((row["index_bytes"] for row in record["networks"]), default=1)
        for row in record["networks"]:
            bits = [str(row["weight_bits"]), str(row["activation_bits"])]
            cells = [f"{row['index_bytes']:,}", change(row["index_bytes"], least), f"{row['decode']['median']:.3f}"]
            rows.append([record["scene"], row["swept"], *bits, *cells, f"{row['train_seconds']:.0f}"])
    return table(head, rows, 2)


def _positions(records: Sequence[Record]) -> str:
    head = ["scene", "bits more", "bits an axis", "positions, bits/anchor", "residuals, bits/anchor", "bytes"]
    head += ["PSNR dB", "SSIM", "decode s"]
    rows = []
    for record in records:
        for row in record["positions"]:
            bits = [f"{row[name]:.1f}" for name in ("axis_bits", "positions_bits", "position_residual_bits")]
            rows.append([record["scene"], f"{row['value']:+g}", *bits, *_cells(row)])
    return table(head, rows)


def _steps(records: Sequence[Record]) -> str:
    names = [name for record in records for row in record["steps"] for name in row["steps"]]
    channels = list(dict.fromkeys(names))
    head = ["scene", "quality", *(name.replace("_", " ") for name in channels), "bytes", "PSNR dB", "SSIM", "decode s"]
    rows = []
    for record in records:
        for row in record["steps"]:
            steps = [f"{row['steps'][name]:.2f}" if name in row["steps"] else "" for name in channels]
            rows.append([record["scene"], f"{row['value']:g}", *steps, *_cells(row)])
    return table(head, rows)


def _cells(row: Record) -> list[str]:
    return [f"{row['bytes']:,}", f"{row['psnr_db']:.2f}", f"{row['ssim']:.4f}", f"{row['decode']['median']:.3f}"]


def entropy_text(records: Sequence[Record]) -> str:
    """A table of one scene's symbols coded in four ways."""
    head = ["scene", "quality", "coded by", "bytes", "", "decode s", "multiply-adds an anchor", "peak MiB"]
    rows = []
    for record in records:
        static = next(row["bytes"] for row in record["kinds"] if row["kind"] == STATIC)
        for row in record["kinds"]:
            cells = [f"{row['bytes']:,}", change(row["bytes"], static), seconds(row["decode"])]
            cells += [f"{row['multiply_adds']:,}", mebibytes(row["decode"]["peak_bytes"])]
            rows.append([record["scene"], f"{record['quality']:g}", row["kind"], *cells])
    return table(head, rows, 3)


def ways_text(records: Sequence[Record]) -> str:
    """One file in every way to decode it."""
    head = ["scene", "quality", "way", "decode s", "CPU s", "times as fast", "peak MiB"]
    rows = []
    for record in records:
        first = next(iter(record["ways"].values()))["median"]
        for name, times in record["ways"].items():
            cells = [seconds(times), f"{times['cpu']:.3f}", f"{first / times['median']:.2f}"]
            rows.append([record["scene"], f"{record['quality']:g}", name, *cells, mebibytes(times["peak_bytes"])])
    absent = sorted({text for record in records for text in record["missing"]})
    return table(head, rows, 3) + "".join(f"\nNot measured: {text}.\n" for text in absent)


def limit_text(records: Sequence[Record]) -> str:
    """Stages with the kernel and without, then the least and how far a decode is from it."""
    return f"{_stages(records)}\n{_limits(records)}"


def _stages(records: Sequence[Record]) -> str:
    head = ["scene", "quality", "stage", "without kernel, s", "with kernel, s", "times as fast"]
    rows = []
    for record in records:
        off, on = record["kernel"]["off"], record["kernel"].get("on", {})
        for name in sorted({**off, **on}, key=lambda name: (name == "whole", -off.get(name, 0.0), -on.get(name, 0.0))):
            cells = [f"{found[name]:.3f}" if name in found else "" for found in (off, on)]
            faster = f"{off[name] / on[name]:.1f}" if name in off and on.get(name) else ""
            rows.append([record["scene"], f"{record['quality']:g}", name, *cells, faster])
    return table(head, rows, 3)


def _limits(records: Sequence[Record]) -> str:
    head = ["scene", "quality", "symbols", "multiply-adds", *(f"{part}, s" for part in PARTS), "least, s"]
    head += ["without kernel, times the least", "with kernel", "peak, ps a multiply-add", "rANS, ns a symbol"]
    rows = []
    for record in records:
        bound, found = record["least"], record["kernel"]
        least = sum(bound["parts"].values())
        counts = [f"{bound['symbols'] / 1e6:.2f} M", f"{bound['multiply_adds'] / 1e9:.2f} G"]
        parts = [f"{bound['parts'][part]:.3f}" for part in PARTS]
        ratios = [f"{found[name]['whole'] / least:.1f}" if name in found else "" for name in ("off", "on")]
        rates = [1e3 * bound["multiply_add_ns"], 1e9 * bound["parts"]["rANS"] / bound["symbols"]]
        told = [*ratios, *(f"{rate:.1f}" for rate in rates)]
        rows.append([record["scene"], f"{record['quality']:g}", *counts, *parts, f"{least:.3f}", *told])
    return table(head, rows)
