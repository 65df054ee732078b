"""A page of one file: the viewer and a scene, to be opened from a disk."""

from __future__ import annotations

import base64
import html
from typing import BinaryIO

from scarfmt.container.source import ByteSource
from scarfmt.errors import InvalidInput
from scarfmt.viewer.offers import PAGE

_PLACE = b"<!--scene-->"
_PIECE_BYTES = 3 << 20
"""A multiple of 3, so that pieces of base64 can be put together."""


def write_page(source: ByteSource, name: str, target: BinaryIO) -> int:
    """Write a page that shows a file of which nothing else is needed.

    Args:
        name: what the page calls it.
        target: gets the page, which is 1.3 MB and four thirds of the file.

    Returns:
        The bytes written.

    Raises:
        InvalidInput: ``input-dependency`` where the page was never built.
    """
    page = PAGE.joinpath("embedded.html")
    if not page.is_file():
        raise InvalidInput("input-dependency", "the viewer page is not in this installation: `make web` builds it")
    before, after = page.read_bytes().split(_PLACE)
    opening = f'<script type="text/plain" id="scene" title="{html.escape(name)}">'.encode()
    size = target.write(before + opening)
    for start in range(0, source.size, _PIECE_BYTES):
        size += target.write(base64.b64encode(source.read(start, min(_PIECE_BYTES, source.size - start))))
    return size + target.write(b"</script>" + after)
