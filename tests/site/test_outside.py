"""Files that a page loads from another host are found; links for a reader to follow are allowed."""

from __future__ import annotations

from pathlib import Path

from docs.site.outside import found

PAGE = """<link rel="stylesheet" href="style.css"><link rel="canonical" href="https://a.example/">
<a href="https://b.example/">b</a><img src="//c.example/c.png"><script src="https://d.example/d.js"></script>
<p style="background: url('https://e.example/e.png')"></p><link rel="stylesheet" href="https://f.example/f.css">"""


def test_what_a_browser_would_fetch_is_found(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(PAGE)
    (tmp_path / "style.css").write_text('@import "https://g.example/g.css"; a { background: url(local.png) }')
    hosts = [line.split("//")[1][0] for line in found(tmp_path)]
    assert hosts == ["c", "d", "e", "f", "g"]


def test_a_page_that_is_alone_passes(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text('<a href="https://b.example/">b</a><img src="c.png">')
    assert not list(found(tmp_path))
