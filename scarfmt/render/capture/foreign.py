"""Camera files that are not read: whose they are, and what to give instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

_EXPORT = "export the cameras there in COLMAP's format"
_HEADS = (
    (b"<?xml", f"XML, such as Metashape's; {_EXPORT}"),
    (b"<document", f"XML of Metashape; {_EXPORT}"),
    (b"#name,", f"a table of RealityScan; {_EXPORT}"),
    (b"# Bundle file", f"a file of Bundler; {_EXPORT}"),
    (b"NVM_V3", f"a file of VisualSFM; {_EXPORT}"),
    (b"\x93NUMPY", "an array, such as LLFF's poses_bounds.npy; give the COLMAP model it was made of"),
    (b"SQLite format 3", "COLMAP's database, which has no poses; give the folder of its sparse model"),
)
"""How files begin, and what they are."""
_MEMBERS = (
    ({"cameras", "shots"}, "a reconstruction of OpenSfM; run 'opensfm export_colmap', and give that"),
    ({"sfm_data_version", "views"}, "a file of openMVG; run 'openMVG_main_openMVG2Colmap', and give that"),
    ({"views", "intrinsics"}, f"a file of Meshroom; {_EXPORT}"),
    ({"t_00", "t_23"}, "one camera of Polycam; run 'ns-process-data polycam', and give its transforms.json"),
    ({"poses", "K"}, "Record3D's; run 'ns-process-data record3d', and give its transforms.json"),
    ({"camera_path"}, "a path for a video; give the cameras of photos"),
)
"""Members that JSON objects have, and what they are."""


def describe_file(path: Path) -> str:
    """What a file is that holds no JSON; empty where nothing is known of it."""
    with path.open("rb") as stream:
        head = stream.read(64).removeprefix(b"\xef\xbb\xbf")
    return next((what for start, what in _HEADS if head.startswith(start)), "")


def describe_document(document: Any) -> str:
    """What a JSON document is, or the first object of an array; empty where nothing is known of it."""
    first = document[0] if isinstance(document, list) and document else document
    members = first.keys() if isinstance(first, dict) else set()
    return next((what for needed, what in _MEMBERS if needed <= members), "")
