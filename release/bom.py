"""The bill of materials, CycloneDX 1.6: what wheel and npm package hold of others, and what the wheel needs.

It is written from the finished artefacts: the wheel's metadata, and what the build of the page found in its bundle.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
import uuid
import zipfile
from email.parser import Parser
from pathlib import Path
from typing import TypedDict

from release.archives import contents
from release.tree import Tree

COMPONENTS = "scarfmt/viewer/page/components.json"
"""In the wheel: what its page holds of others."""
_NAMES = uuid.UUID("6f0d2f0c-6c1b-5f0e-9d53-5f3e5a1f0d28")
"""Name space of this project, for serial numbers that depend on the content alone."""
_OWN = "Apache-2.0"
Entry = dict[str, object]


class Bundled(TypedDict):
    """One of the page's components: `kind` is a package type of purl, `version` may be unknown."""

    name: str
    version: str | None
    licence: str
    kind: str


def write_bill(tree: Tree, out: Path) -> Path:
    """Write `scarfmt-VERSION.cdx.json` into the folder with the other artefacts.

    Raises:
        ValueError: the npm package depends on something, which this bill would leave out.
    """
    version = tree.version()
    (wheel,) = out.glob(f"scarfmt-{version}-*.whl")
    npm = out / f"scar-stream-{version}.tgz"
    described = json.loads(contents(npm)["package/package.json"])
    if described.get("dependencies"):
        raise ValueError(f"{npm.name} has dependencies: add them to the bill")
    bundled = [_component(one) for one in list_bundled(wheel)]
    page = _artefact(wheel, "pypi", "scarfmt", version) | {"components": bundled}
    parts = [page, _artefact(npm, "npm", "scar-stream", version), *_list_required(wheel)]
    target = out / f"scarfmt-{version}.cdx.json"
    target.write_text(json.dumps(_bill(parts, version, tree.epoch), indent=1) + "\n", encoding="utf-8")
    return target


def list_bundled(wheel: Path) -> list[Bundled]:
    """The packages of others in the page of a wheel, as its build wrote them down."""
    with zipfile.ZipFile(wheel) as archive:
        found: list[Bundled] = json.loads(archive.read(COMPONENTS))
    return found


def _bill(parts: list[Entry], version: str, epoch: int) -> Entry:
    content = json.dumps(parts, sort_keys=True)
    subject = {"type": "library", "bom-ref": "release", "name": "scarfmt", "version": version, **_licence(_OWN)}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(_NAMES, content)}",
        "version": 1,
        "metadata": {"timestamp": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(epoch)), "component": subject},
        "components": parts,
    }


def _artefact(path: Path, kind: str, name: str, version: str) -> Entry:
    sums = [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}]
    return {"type": "library", "bom-ref": path.name, "name": name, "version": version, "scope": "required",
            "hashes": sums, **_licence(_OWN), "purl": f"pkg:{kind}/{name}@{version}"}  # fmt: skip


def _component(one: Bundled) -> Entry:
    version = {"version": one["version"]} if one["version"] else {}
    at = f"@{one['version']}" if one["version"] else ""
    purl = f"pkg:{one['kind']}/{one['name'].replace('@', '%40')}{at}"
    named = {"type": "library", "bom-ref": purl, "name": one["name"], **version}
    return named | _licence(one["licence"]) | {"purl": purl}


def _list_required(wheel: Path) -> list[Entry]:
    """Packages that pip brings beside the wheel, those of extras as optional; not in it, so of no fixed version."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(name).decode())
    scopes: dict[str, str] = {}
    for line in metadata.get_all("Requires-Dist", []):
        needed = re.split(r"[\s<>=!~\[;]", line)[0].lower()
        scope = "optional" if "extra ==" in line else "required"
        scopes[needed] = "required" if "required" in (scope, scopes.get(needed)) else scope
    scopes.pop(metadata["Name"], None)  # an extra may bring another one
    return [
        {"type": "library", "bom-ref": f"pkg:pypi/{name}", "name": name, "scope": scope, "purl": f"pkg:pypi/{name}"}
        for name, scope in sorted(scopes.items())
    ]


def _licence(expression: str) -> Entry:
    return {"licenses": [{"expression": expression}]}
