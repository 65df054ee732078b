"""The browser package, `scar-stream`, as npm packs it; with it the page of `scarfmt view`, which the wheel holds."""

from __future__ import annotations

from pathlib import Path

from release.archives import settle_tar
from release.tree import Tree


def build_web(tree: Tree, tools: Path) -> None:
    """Build `web/dist` and the viewer page of a tree.

    Args:
        tools: an environment with `web/requirements.txt`.

    Raises:
        subprocess.CalledProcessError: something could not be fetched, compiled or bundled.
    """
    tree.run(["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--prefer-offline", "--silent"], "web")
    tree.run(["env", f"PYTHON={tools / 'bin' / 'python'}", "npm", "run", "--silent", "build"], "web")


def pack_npm(tree: Tree, out: Path) -> Path:
    """Write `scar-stream-VERSION.tgz` into a folder, once `build_web` has built it."""
    tree.run(["npm", "pack", "--silent", "--pack-destination", out], "web")
    packed = out / f"scar-stream-{tree.version()}.tgz"
    # npm keeps the modes of what was written here, and those depend on who builds.
    settle_tar(packed, tree.epoch)
    return packed
