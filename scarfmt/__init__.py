"""scarfmt: the `.scar` format for progressive neural-compressed 3D Gaussian scenes. See SPEC.md.

    import scarfmt

    scarfmt.encode("scene.ply")                      # bytes of a file
    scarfmt.train("capture/").data                   # bytes of one trained from photos
    scarfmt.decode_scene("scene.scar", layers=2)     # Gaussians of its first two layers
    scarfmt.decode("scene.scar").values              # exact values, as every decoder has them
    with scarfmt.open("scene.scar") as file: ...     # more than one question to one file
    with scarfmt.open_scene("city.scar.json") as s: ...  # a file, or an index of many, by region or for a view

Importing the package costs nothing: the names below are loaded when they are first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # checkers of types take it for true; importing `typing` takes longer than all the rest here

if TYPE_CHECKING:
    from typing import Any

    from reference_decoder.request import DecodeRequest
    from reference_decoder.scenes.needs import LevelOfDetail
    from reference_decoder.scenes.scene_set import SceneSet
    from reference_encoder.options import EncodeOptions
    from reference_encoder.training.capture import load_capture
    from reference_encoder.training.options import TrainOptions
    from scarfmt.api import (
        ScarFile,
        decode,
        decode_scene,
        encode,
        inspect,
        open,
        open_scene,
        train,
        truncate,
        validate,
    )
    from scarfmt.errors import InputWarning, ScarError
    from scarfmt.render.capture import load_cameras
    from scarfmt.scene.gaussians import AnchorModel, GaussianScene
    from scarfmt.streaming.view import Camera

__version__ = "0.2.0"

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
    "SceneSet",
    "TrainOptions",
    "__version__",
    "decode",
    "decode_scene",
    "encode",
    "inspect",
    "load_cameras",
    "load_capture",
    "open",
    "open_scene",
    "train",
    "truncate",
    "validate",
]

_HOMES = {
    "AnchorModel": "scarfmt.scene.gaussians",
    "Camera": "scarfmt.streaming.view",
    "DecodeRequest": "reference_decoder.request",
    "EncodeOptions": "reference_encoder.options",
    "GaussianScene": "scarfmt.scene.gaussians",
    "InputWarning": "scarfmt.errors",
    "LevelOfDetail": "reference_decoder.scenes.needs",
    "ScarError": "scarfmt.errors",
    "SceneSet": "reference_decoder.scenes.scene_set",
    "TrainOptions": "reference_encoder.training.options",
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
