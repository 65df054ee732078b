"""Whether a scene index and its files keep the rules of the specification: all that can be found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from reference_decoder.decode import iter_tiles
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.scene_set import SceneSet
from scarfmt.coding.writer import Report, silent
from scarfmt.container.source import ByteSource
from scarfmt.errors import ScarError
from scarfmt.scene_index.document import ListedFile
from scarfmt.tools.validate import Finding, Validation, validate


@dataclass
class SceneValidation:
    """The findings of a validation.

    Attributes:
        files: of each file that could be opened, by uri, what was found in it.
        findings: what is wrong between index and files, with the uri in `field`.
    """

    files: dict[str, Validation] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)

    @property
    def valid(self) -> bool:
        """Whether no rule is broken."""
        return not self.findings and all(file.valid for file in self.files.values())

    def as_json(self) -> dict[str, Any]:
        """A JSON-able description."""
        files = [{"uri": uri, **found.as_json()} for uri, found in self.files.items()]
        return {"valid": self.valid, "findings": [vars(finding) for finding in self.findings], "files": files}


def validate_scene(scene: SceneSet, *, layers: int | None = None, report: Report = silent) -> SceneValidation:
    """Check every file of a scene, that it is the one listed, and that its anchors are in its box (R-17-8, R-17-9).

    Args:
        scene: opened; its limits are those of the check.
        layers: check only the first so many layers of each file.
        report: told about progress, file by file.
    """
    found = SceneValidation()
    for number, listed in enumerate(scene.index.files):
        report("checking files", number / len(scene.files))
        try:
            with scene.files.opened(number) as source:
                asked = None if layers is None else min(layers, len(listed.layers))
                found.files[listed.uri] = validate(source, layers=asked, limits=scene.files.limits)
                if found.files[listed.uri].valid:
                    _check_box(listed, source, scene, asked, found)
        except ScarError as error:
            found.findings.append(Finding(error.refusal, error.message, error.offset, listed.uri))
    return found


def _check_box(
    listed: ListedFile, source: ByteSource, scene: SceneSet, layers: int | None, found: SceneValidation
) -> None:
    low, high = np.array(listed.low), np.array(listed.high)
    asked = replace(_POSITIONS, layers=layers, limits=scene.files.limits)
    for part in iter_tiles(source, asked):
        assert part.positions is not None
        outside = int(((part.positions < low) | (part.positions > high)).any(axis=1).sum())
        if outside:
            message = f"{outside} anchors of tile {int(part.tiles[0])} are outside of the box that the index tells"
            found.findings.append(Finding("scene-file", message, None, listed.uri))
            return


_POSITIONS = DecodeRequest(attributes=("positions",))
