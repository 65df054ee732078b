"""Whether `scarfmt view` serves its page and a scene: ``python try_view.py SCARFMT FILE``."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import parse_qs, urljoin, urlsplit
from urllib.request import Request, urlopen

FIRST = 64
"""Bytes of the scene that are asked for."""


def main() -> int:
    """Command line: 0 if page, its scripts and licences and the first bytes of the scene come as they are."""
    program, scene = sys.argv[1:3]
    server = subprocess.Popen([program, "view", scene, "--no-browser"], stderr=subprocess.PIPE, text=True)
    try:
        assert server.stderr is not None  # it is piped
        found = re.search(r"http://\S+", server.stderr.readline())
        assert found is not None, "no address was printed"
        address = found[0]
        page = urlopen(address, timeout=30).read().decode()
        for name in [*re.findall(r'href="([\w.-]+\.(?:js|wasm))"', page), "licences.txt", "components.json"]:
            assert urlopen(urljoin(address, name), timeout=30).read(), name
        (url,) = parse_qs(urlsplit(address).query)["url"]
        part = Request(urljoin(address, url), headers={"Range": f"bytes=0-{FIRST - 1}"})
        assert urlopen(part, timeout=30).read() == Path(scene).read_bytes()[:FIRST], "the scene is another"
    finally:
        server.terminate()
        server.wait(timeout=30)
    print(f"{address}: page, scripts and scene are served")
    return 0


if __name__ == "__main__":
    sys.exit(main())
