"""What the file of a scene says about it beside its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from scarfmt.container.header import HeaderFields
from scarfmt.container.registries import ColourSpace, RenderModel


@dataclass(frozen=True)
class Description:
    """What a file says about its scene; the defaults stand for a file that says nothing.

    Attributes:
        render_model: how its Gaussians are to be drawn.
        up_axis: the axis of the scene, as read, that points up: ``"x"``, ``"-y"`` and so on; None where nothing says.
        colour_space: what its colours measure.
        coordinate_reference: the system of its coordinates, as the file names it, e.g. ``"EPSG:25832"``; or empty.
        origin: what has to be added to its positions for coordinates in that system, its units.
    """

    render_model: RenderModel = RenderModel.CLASSIC
    up_axis: str | None = None
    colour_space: ColourSpace = ColourSpace.UNSPECIFIED
    coordinate_reference: str = ""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of_header(cls, fields: HeaderFields) -> Description:
        """What the header of a .scar file says; its METADATA may say more."""
        return cls(fields.render_model, colour_space=fields.colour_space)

    def metadata(self) -> dict[str, Any]:
        """The members of METADATA that keep the coordinate reference (SPEC §7.10)."""
        if not self.coordinate_reference and not any(self.origin):
            return {}
        return {"coordinate_reference": {"crs": self.coordinate_reference or _UNNAMED, "origin": list(self.origin)}}

    def with_metadata(self, metadata: Mapping[str, Any]) -> Description:
        """The description with what METADATA, checked by its rules, adds: the up axis and the coordinate reference."""
        survey, reference = metadata.get("survey"), metadata.get("coordinate_reference")
        found = self
        if isinstance(survey, Mapping) and survey.get("up_detected") is False:
            up_axis = str(survey.get("up")).partition(":")[0]
            found = replace(found, up_axis=up_axis if up_axis in UP_AXES else None)
        if reference is not None:
            x, y, z = map(float, reference["origin"])
            crs = "" if reference["crs"] == _UNNAMED else reference["crs"]
            found = replace(found, coordinate_reference=crs, origin=(x, y, z))
        return found


UP_AXES = ("x", "-x", "y", "-y", "z", "-z")
USUAL_UP = "-y"
"""Of the axes that COLMAP and INRIA's trainer have."""
NOTHING_SAID = Description()
_UNNAMED = "unknown"
