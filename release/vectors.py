"""The vectors package: what a decoder in any language is scored by, in one ZIP, without any Python."""

from __future__ import annotations

from pathlib import Path

from scarfmt_conformance.archive import suite_files, write_zip

from release.tree import Tree

_TEXTS = ("LICENSE", "LICENSE-CC0", "SPEC.md", "SPEC-neural.md")


def write_vectors(tree: Tree, out: Path) -> Path:
    """Write `scar-vectors-VERSION.zip` into a folder; `scarfmt conformance run --suite` takes it as it is."""
    conformance = tree.folder / "conformance"
    members = suite_files(conformance)
    members["rules.json"] = (conformance / "rules.json").read_bytes()
    members |= {name: (tree.folder / name).read_bytes() for name in _TEXTS}
    readme = (tree.folder / "release" / "vectors.md").read_text(encoding="utf-8")
    members["README.md"] = readme.replace("VERSION", tree.version()).encode()
    target = out / f"scar-vectors-{tree.version()}.zip"
    write_zip(target, members, compressed=True)
    return target
