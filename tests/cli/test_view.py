"""`scarfmt view`: what is checked before anything is served, and where the browser is sent."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from scarfmt.viewer import server as serving
from tests.cli.conftest import run
from tests.conftest import REPOSITORY

SCENE = REPOSITORY / "web" / "test" / "data" / "toys.scar"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses that a browser was sent to; nothing is served, and the page is a stand-in."""
    monkeypatch.setattr("scarfmt.viewer.offers.page_offers", dict)
    monkeypatch.setattr(serving, "serve", lambda server: server.server_close())
    addresses: list[str] = []
    monkeypatch.setattr(click, "launch", addresses.append)
    return addresses


def test_the_browser_is_sent_to_the_scene(opened: list[str]) -> None:
    done = run("view", SCENE)
    assert done.exit_code == 0, done.output
    assert len(opened) == 1
    assert opened[0].startswith("http://127.0.0.1:")
    assert opened[0].endswith("/?url=/scenes/0/toys.scar")
    assert opened[0] in done.output


def test_two_scenes_are_shown_beside_each_other(opened: list[str]) -> None:
    run("view", SCENE, SCENE)
    assert opened[0].endswith("/?url=/scenes/0/toys.scar&beside=/scenes/1/toys.scar")


def test_nothing_is_opened_on_request(opened: list[str]) -> None:
    done = run("view", SCENE, "--no-browser")
    assert (done.exit_code, opened) == (0, [])
    assert "http://127.0.0.1:" in done.output


def test_what_is_no_scar_file_is_refused_before_a_browser_opens(opened: list[str], tmp_path: Path) -> None:
    other = tmp_path / "photo.scar"
    other.write_bytes(b"\x89PNG" * 100)
    for name, refusal in ((str(other), "bad-signature"), (str(tmp_path / "none.scar"), "input-source")):
        done = run("view", name)
        assert (done.exit_code, opened) == (1, [])
        assert refusal in done.output


def test_a_taken_port_is_one_clear_line(opened: list[str]) -> None:
    with serving.ViewerServer({}) as taken:
        port = str(taken.server_address[1])
        done = run("view", SCENE, "--port", port)
    assert (done.exit_code, opened) == (1, [])
    assert f"port {port}" in done.output
