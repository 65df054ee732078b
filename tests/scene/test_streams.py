"""The properties of each stream kind are declared once (SPEC §6.4, §16.6)."""

from __future__ import annotations

import subprocess
import sys

from scarfmt.container.registries import Stream
from scarfmt.scene.streams import ATTRIBUTES, CHANNEL_STREAMS


def test_users_reach_every_channel_by_a_name() -> None:
    """LATENT refines what the indices give, and comes with them."""
    assert set(ATTRIBUTES.values()) == set(CHANNEL_STREAMS) - {Stream.LATENT} | {Stream.INDICES}


def test_names_are_at_hand_without_numpy() -> None:
    """The command line prints them in its help, before anything is imported."""
    code = "import sys, scarfmt.scene.streams; sys.exit('numpy' in sys.modules or 'construct' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
