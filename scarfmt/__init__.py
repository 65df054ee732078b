"""scarfmt: the `.scar` format for progressive compressed 3D Gaussian scenes. See SPEC.md.

    import scarfmt

    scene = scarfmt.load("scene.ply")                # Gaussians of a file of any format
    scarfmt.save(scene, "scene.scar")                # and back: the name says the format
    scarfmt.encode("scene.ply")                      # bytes of a .scar file
    scarfmt.train("capture/").data                   # bytes of one trained from photos
    scarfmt.decode_scene("scene.scar", layers=2)     # Gaussians of its first two layers
    scarfmt.decode("scene.scar").values              # exact values, as every decoder has them
    with scarfmt.open("scene.scar") as file: ...     # more than one question to one file

Importing the package costs nothing: the names below are loaded when they are first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # checkers of types take it for true; importing `typing` takes longer than all the rest here

if TYPE_CHECKING:
    from typing import Any

    from reference_decoder.decode import DecodeRequest, decode, decode_scene
    from reference_decoder.lod_selection import LevelOfDetail
    from reference_encoder.options import EncodeOptions
    from reference_encoder.training.capture import load_capture
    from reference_encoder.training.options import TrainOptions
    from scarfmt.api import (
        ScarFile,
        convert,
        decode_view,
        encode,
        inspect,
        load,
        open,
        save,
        train,
        truncate,
        validate,
    )
    from scarfmt.errors import InputWarning, ScarError
    from scarfmt.render.capture import load_cameras
    from scarfmt.scene.gaussians import AnchorModel, GaussianScene
    from scarfmt.view_planning import Camera

__version__ = "0.3.0"

__all__ = [
    "AnchorModel",
    "Camera",
    "DecodeRequest",
    "EncodeOptions",
    "GaussianScene",
    "InputWarning",
    "LevelOfDetail",
    "ScarError",
    "ScarFile",
    "TrainOptions",
    "__version__",
    "convert",
    "decode",
    "decode_scene",
    "decode_view",
    "encode",
    "inspect",
    "load",
    "load_cameras",
    "load_capture",
    "open",
    "save",
    "train",
    "truncate",
    "validate",
]

_HOMES = {
    "AnchorModel": "scarfmt.scene.gaussians",
    "Camera": "scarfmt.view_planning",
    "DecodeRequest": "reference_decoder.decode",
    "EncodeOptions": "reference_encoder.options",
    "GaussianScene": "scarfmt.scene.gaussians",
    "InputWarning": "scarfmt.errors",
    "LevelOfDetail": "reference_decoder.lod_selection",
    "ScarError": "scarfmt.errors",
    "TrainOptions": "reference_encoder.training.options",
    "decode": "reference_decoder.decode",
    "decode_scene": "reference_decoder.decode",
    "load_cameras": "scarfmt.render.capture",
    "load_capture": "reference_encoder.training.capture",
}
"""The module of each public name that is not defined in `scarfmt.api`."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(_HOMES.get(name, "scarfmt.api")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
