"""The vectors package: what a decoder in any language is scored by, in one ZIP, without any Python."""

from __future__ import annotations

from pathlib import Path

from scarfmt_conformance.archive import suite_files

from release.archives import write_zip
from release.tree import Tree

_OF_SCENES = ("scene.schema.json", "rules.json")
_TEXTS = {"LICENSE": "LICENSE", "LICENSE-CC0": "LICENSE-CC0", "SPEC.md": "SPEC.md"}


def write_vectors(tree: Tree, out: Path) -> Path:
    """Write `scar-vectors-VERSION.zip` into a folder; `scarfmt conformance run --suite` takes it as it is."""
    conformance = tree.folder / "conformance"
    indices = (path for path in (conformance / "scene_index").rglob("*") if path.is_file() and path.suffix != ".py")
    paths = [*suite_files(conformance), *(conformance / name for name in _OF_SCENES), *indices]
    members = {path.relative_to(conformance).as_posix(): path.read_bytes() for path in paths}
    members |= {name: (tree.folder / path).read_bytes() for name, path in _TEXTS.items()}
    readme = (tree.folder / "release" / "vectors.md").read_text(encoding="utf-8")
    members["README.md"] = readme.replace("VERSION", tree.version()).encode()
    target = out / f"scar-vectors-{tree.version()}.zip"
    write_zip(target, members, tree.epoch)
    return target

