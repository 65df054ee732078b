"""A page of one file holds the scene whole, whatever its size and name."""

from __future__ import annotations

import base64
import io
from pathlib import Path

import pytest

from scarfmt.container.source import BytesSource
from scarfmt.viewer import embedded


def test_the_scene_is_in_the_page_with_a_name_that_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "embedded.html").write_bytes(b"<body><!--scene--></body>")
    monkeypatch.setattr(embedded, "PAGE", tmp_path)
    data, target = bytes(range(256)) * (1 << 14) + b"!", io.BytesIO()
    size = embedded.write_page(BytesSource(data), '"><script>', target)
    head, scene, tail = target.getvalue().partition(base64.b64encode(data))
    assert (size, len(scene) > 0) == (len(target.getvalue()), True)
    assert head == b'<body><script type="text/plain" id="scene" title="&quot;&gt;&lt;script&gt;">'
    assert tail == b"</script></body>"
