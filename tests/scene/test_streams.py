"""The properties of each stream kind are declared once (SPEC §6.4, §16.6)."""

from __future__ import annotations

import subprocess
import sys

from scarfmt.container.registries import Profile, Stream
from scarfmt.scene.streams import (
    ATTRIBUTES,
    CHANNEL_STREAMS,
    CONTEXT_STREAMS,
    PREDICTED_STREAMS,
    STREAMS,
    components,
    needed,
)


def test_every_stream_of_a_tile_block_is_registered_once_and_ascending() -> None:
    """Models and framing are counted in layer summaries, but no sub-stream carries them."""
    assert list(STREAMS) == [stream for stream in Stream if stream not in (Stream.MODELS, Stream.FRAMING)]
    assert all(stream == spec.stream for stream, spec in STREAMS.items())


def test_what_is_needed_can_occur() -> None:
    """A profile that needed a stream it may not have would have no scene."""
    for profile in Profile:
        assert needed(profile) <= set(components(profile)) <= set(CHANNEL_STREAMS)


def test_only_channels_are_context() -> None:
    """The context of symbols is made of channel values (SPEC §10.2)."""
    assert set(CHANNEL_STREAMS) > CONTEXT_STREAMS == {Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR}


def test_latents_may_be_predicted_though_they_are_no_context() -> None:
    """Nothing that has predictors looks at LATENT but LATENT itself (SPEC §10.3)."""
    assert set(CHANNEL_STREAMS) > PREDICTED_STREAMS == CONTEXT_STREAMS | {Stream.LATENT}


def test_users_reach_every_channel_by_a_name() -> None:
    """LATENT refines what the indices give, and comes with them."""
    assert set(ATTRIBUTES.values()) == set(CHANNEL_STREAMS) - {Stream.LATENT} | {Stream.INDICES}


def test_names_are_at_hand_without_numpy() -> None:
    """The command line prints them in its help, before anything is imported."""
    code = "import sys, scarfmt.scene.streams; sys.exit('numpy' in sys.modules or 'construct' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
