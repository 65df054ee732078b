"""The invalid vectors of model blocks (SPEC §6.4-§6.5, §7.8-§7.12, §8.3, §8.4, §10): one rule broken each."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.faults.block_faults import codebook_faults, decoder_faults, idle_faults, scene_faults, table_faults
from conformance.faults.layer_faults import layer_faults
from conformance.faults.network_faults import grid_faults, network_faults, predictor_faults
from conformance.scenes.cases import Case, refused
from scarfmt.coding.writer import QuantisedScene

Files = dict[str, tuple[bytes, QuantisedScene]]


def model_faults(files: Files) -> Iterator[Case]:
    """Files with a broken model block.

    Args:
        files: valid vectors by name.
    """
    static = files["sh-from-network"]
    data = {name: file for name, (file, _) in files.items()}
    for faults in (
        layer_faults(files["explicit-refined"], files["anchors-32-slots"], static),
        table_faults(static[0]),
        codebook_faults(static[0], data["explicit-refined"]),
        decoder_faults(static[0], data["explicit-refined"]),
        idle_faults(static[0], data["duplicates"]),
        scene_faults(data["anchors"], data["explicit-refined"]),
        network_faults(data["index-two-level"], data["index-flat"], data["index-equal"], data["predictors"]),
        grid_faults(data["index-grid-small"], static[0], data["index-modes"]),
        predictor_faults(data["predictors"], data["predictors-edge"], data["predictors-alone"]),
    ):
        yield from (refused(*fault, stage="models") for fault in faults)
