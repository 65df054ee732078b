"""Projects of SuperSplat, `.ssproj`, version 0: a ZIP of `document.json` and `splat_0.ply`, `splat_1.ply` and so on.

The document has for each PLY where it stands, whether it shows, and how its colours are graded. Edits of Gaussians are
in the PLY. The editor's axes are y up: as when it exports a PLY, the scene is turned by half a turn about z. Grading is
not applied.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput, Unsupported, plural
from scarfmt.formats import inria_ply
from scarfmt.formats.source import Source, member_names, open_archive
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene, concatenate
from scarfmt.scene.placement import compose, place_scene

_DOCUMENT = "document.json"
_EXPORT = "export the scene in SuperSplat as a PLY"
_TO_RDF = np.diag([-1.0, -1.0, 1.0, 1.0])
_WHITE = [1, 1, 1, 1]
_UNGRADED = {
    "tintClr": _WHITE, "temperature": 0, "saturation": 1, "brightness": 0, "blackPoint": 0, "whitePoint": 1,
    "transparency": 1,
}  # fmt: skip
"""What changes colours and opacities, and the values that leave them as they are."""


def sniff(source: Source) -> bool:
    """Whether the content is a ZIP archive with the document of a project."""
    return _DOCUMENT in member_names(source)


def load(source: Source) -> GaussianScene:
    """Read all splats that the project shows, each where it stands.

    Raises:
        InvalidInput: damaged; ``input-empty``: nothing is shown.
        Unsupported: another version, or a splat that is mirrored or sheared.
        LimitExceeded: more than such an archive holds.

    Warns:
        InputWarning: hidden splats, or the grading of colours, are left out.
    """
    splats = _splats(source)
    shown = [(file, splat) for file, splat in splats if splat.get("visible", True)]
    if not shown:
        raise InvalidInput("input-empty", f"{source.name}: the project shows nothing; show a splat, and save it again")
    if len(shown) < len(splats):
        source.warn(f"{plural(len(splats) - len(shown), 'hidden splat')} left out")
    graded = [field for field, plain in _UNGRADED.items() if any(s.get(field, plain) != plain for _, s in shown)]
    if graded:
        source.warn(f"colours are read without their grading ({', '.join(graded)}); to have it, {_EXPORT}")
    parts = [_place(source, inria_ply.load(file), splat) for file, splat in shown]
    source.check_count(sum(map(len, parts)))
    return concatenate(parts)


def describe(source: Source) -> Description:
    """What the comments and columns of the PLY files say: how they were trained."""
    return Description(max(inria_ply.describe(file).render_model for file, _ in _splats(source)))


def _splats(source: Source) -> list[tuple[Source, dict[str, Any]]]:
    """The PLY files, and what the document says of each."""
    with open_archive(source) as archive:
        document = Source(archive.read(_DOCUMENT), f"{source.name}/{_DOCUMENT}").json()
        if document.get("version") != 0 or not isinstance(document.get("splats"), list):
            message = f"{source.name}: a project of SuperSplat of version {str(document.get('version'))[:40]!r}"
            raise Unsupported("input-version", f"{message}; this importer reads 0; {_EXPORT}", field=_DOCUMENT)
        names = [f"splat_{index}.ply" for index in range(len(document["splats"]))]
        files = [Source(archive.read(name), f"{source.name}/{name}") for name in names]
    if not all(isinstance(splat, dict) for splat in document["splats"]):
        raise source.corrupt("expected JSON objects", field="splats")
    return list(zip(files, document["splats"], strict=True))


def _place(source: Source, scene: GaussianScene, splat: dict[str, Any]) -> GaussianScene:
    matrix: F64 = _TO_RDF @ compose(
        source.vector(splat, "position", (0, 0, 0)),
        source.vector(splat, "rotation", (0, 0, 0, 1)),
        source.vector(splat, "scale", (1, 1, 1)),
    )
    try:
        return place_scene(scene, matrix)
    except ValueError as error:
        message = f"{source.name}: {str(splat.get('name'))[:80]!r} is mirrored or sheared ({error}); {_EXPORT}"
        raise Unsupported("input-range", message, field="splats") from error
