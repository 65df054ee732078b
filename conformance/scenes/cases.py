"""A vector before it is written: its bytes, and the results that a decoder must give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from conformance.scenes.made import Plan, build
from conformance.writer.file import PLAIN, write_file
from conformance.writer.options import WriteOptions
from scarfmt.coding.writer import QuantisedScene

Fault = tuple[str, str, str, str, bytes]
"""A file to be refused: name, what is wrong, the rule broken and perhaps others, refusal id, file."""


@dataclass(frozen=True)
class Case:
    """One vector.

    Attributes:
        id: folder below ``vectors/``: class, slash, name.
        purpose: what it is there for, one sentence.
        data: the file.
        rules: rules of SPEC.md that it exercises; of a file to be refused, the one it breaks.
        features: words to select vectors by, such as ``hash-grid``; those that follow from the file are added.
        scene: what the file holds; None if it must be refused.
        layers: decoded are the first so many layers of `scene`, None for all; the file has no more that is sound.
        refusals: the ids it may be refused with; one for a file that must be refused.
        stage: where the refusal comes at the latest: ``container``, ``models``, ``tiles``, ``metadata`` or
            ``streaming``.
        extend_to: length up to which zeros follow the file, 0 for none.
        camera: centre for which the Gaussians of the anchor profile are pinned; None: `origin` of the header.
        origin: the vector an editor made this from, with `layers`.
    """

    id: str
    purpose: str
    data: bytes
    rules: tuple[str, ...] = ()
    features: tuple[str, ...] = ()
    scene: QuantisedScene | None = None
    layers: int | None = None
    refusals: tuple[str, ...] = ()
    stage: str = "tiles"
    extend_to: int = 0
    camera: tuple[float, float, float] | None = None
    origin: str | None = None

    @property
    def result(self) -> str:
        """``decoded``, ``refused`` or ``either``."""
        if self.id.startswith("either/"):
            return "either"
        return "refused" if self.refusals else "decoded"


def edge(
    name: str, purpose: str, scene: Plan | QuantisedScene, rules: Sequence[str], options: WriteOptions = PLAIN,
    features: Sequence[str] = (),
) -> Case:  # fmt: skip
    """A valid file at an end of what is allowed."""
    made = build(scene) if isinstance(scene, Plan) else scene
    return Case(f"edge/{name}", purpose, write_file(made, options), tuple(rules), tuple(features), made)


def refuse(
    name: str, purpose: str, rules: str, refusal: str, data: bytes, stage: str = "tiles", extend_to: int = 0
) -> Case:
    """A file that breaks a rule: the first of `rules`, which blanks separate."""
    return Case(f"invalid/{name}", purpose, data, tuple(rules.split()), refusals=(refusal,), stage=stage,
                extend_to=extend_to)  # fmt: skip


def take(name: str, purpose: str, data: bytes, scene: QuantisedScene, rule: str, *refusals: str) -> Case:
    """A file that a decoder may take, and then gets the scene, or refuse."""
    return Case(f"either/{name}", purpose, data, (rule,), scene=scene, refusals=refusals)
