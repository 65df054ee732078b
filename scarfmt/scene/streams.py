"""The stream kinds: for each its codec, profiles and number of components (SPEC §6.4, §7, §16.6).

Adding a stream starts here; `docs/under-the-hood.md` says what follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from scarfmt.container.registries import Profile, Stream


class Codec(Enum):
    """The coder of the symbols of a sub-stream."""

    POSITIONS = auto()
    """:mod:`scarfmt.codecs.positions`, of the anchors that are new (SPEC §7.2)."""
    CLASSES = auto()
    """:mod:`scarfmt.codecs.classes`, of the anchors that are new (SPEC §7.3)."""
    MASKS = auto()
    """:mod:`scarfmt.codecs.masks`, of the slots that are off (SPEC §7.4)."""
    CHANNEL = auto()
    """:mod:`scarfmt.codecs.channels`, step by step (SPEC §7.5)."""
    SLOT_CHANNEL = auto()
    """:mod:`scarfmt.codecs.masks`, at once, of the slots that are turned on (SPEC §7.7)."""
    INDICES = auto()
    """:mod:`scarfmt.codecs.indices`, or the index network's :mod:`scarfmt.codecs.neural_indices` (SPEC §7.6, §10.5)."""


OF_NEW_ANCHORS = (Codec.POSITIONS, Codec.CLASSES)
"""For these a layer in which no anchor appears has nothing (SPEC §7.1)."""


@dataclass(frozen=True)
class StreamSpec:
    """One stream kind that a TILE block may hold.

    Attributes:
        stream: its number.
        codec: who codes it.
        profiles: those it may occur in -> its components; None where the number is the file's, 1..64. Of what is not a
            channel it is 0.
        needed: profiles without which nothing could be drawn.
        is_context: whether its decoded values are context for other symbols (SPEC §10.2).
        is_predicted: whether it may have predictors although it is not (SPEC §10.3).
        attribute: what users call it in requests, None where it is never asked for by itself.
    """

    stream: Stream
    codec: Codec
    profiles: Mapping[Profile, int | None] = field(default_factory=lambda: {Profile.EXPLICIT: 0, Profile.ANCHOR: 0})
    needed: frozenset[Profile] = frozenset()
    is_context: bool = False
    is_predicted: bool = False
    attribute: str | None = None

    @property
    def is_channel(self) -> bool:
        """Whether a channel table lists it."""
        return self.codec in (Codec.CHANNEL, Codec.SLOT_CHANNEL)


_EXPLICIT, _ANCHOR = Profile.EXPLICIT, Profile.ANCHOR
_BOTH = frozenset({_EXPLICIT, _ANCHOR})

STREAMS: Mapping[Stream, StreamSpec] = {
    spec.stream: spec
    for spec in (
        StreamSpec(Stream.POSITIONS, Codec.POSITIONS),
        StreamSpec(Stream.CLASSES, Codec.CLASSES),
        StreamSpec(Stream.MASKS, Codec.MASKS, {_ANCHOR: 0}),
        StreamSpec(Stream.POSITION_RESIDUAL, Codec.CHANNEL, {_EXPLICIT: 3, _ANCHOR: 3}, attribute="positions"),
        StreamSpec(
            Stream.SCALE, Codec.CHANNEL, {_EXPLICIT: 3, _ANCHOR: 6}, needed=_BOTH, is_context=True, attribute="scales"
        ),
        StreamSpec(Stream.ROTATION, Codec.CHANNEL, {_EXPLICIT: 3}, is_context=True, attribute="rotations"),
        StreamSpec(Stream.OPACITY, Codec.CHANNEL, {_EXPLICIT: 1}, is_context=True, attribute="opacity"),
        StreamSpec(Stream.COLOUR, Codec.CHANNEL, {_EXPLICIT: 3}, is_context=True, attribute="colour"),
        # What users ask for as latents are indices and, where there are any, their refinements.
        StreamSpec(Stream.INDICES, Codec.INDICES, attribute="latents"),
        StreamSpec(Stream.LATENT, Codec.CHANNEL, {_EXPLICIT: None, _ANCHOR: None}, is_predicted=True),
        StreamSpec(Stream.OFFSETS, Codec.SLOT_CHANNEL, {_ANCHOR: 3}, needed=frozenset({_ANCHOR}), attribute="offsets"),
    )
}
"""Every stream kind a TILE block may hold, ascending."""

CHANNEL_STREAMS = tuple(spec.stream for spec in STREAMS.values() if spec.is_channel)
"""Streams that a channel table may list, ascending."""

CONTEXT_STREAMS = frozenset(spec.stream for spec in STREAMS.values() if spec.is_context)
"""Channels whose decoded values are context for others (SPEC §10.2)."""

PREDICTED_STREAMS = CONTEXT_STREAMS | {spec.stream for spec in STREAMS.values() if spec.is_predicted}
"""Channels that may have predictors (SPEC §10.3)."""

ATTRIBUTES: Mapping[str, Stream] = {
    spec.attribute: spec.stream for spec in STREAMS.values() if spec.attribute is not None
}
"""Names of what can be asked for on its own, and the sub-stream each needs; latents need LATENT too."""


def components(profile: Profile) -> dict[Stream, int | None]:
    """Components of each channel that a profile may have; None: as many as the latent has dimensions."""
    channels = (spec for spec in STREAMS.values() if spec.is_channel)
    return {spec.stream: spec.profiles[profile] for spec in channels if profile in spec.profiles}


def needed(profile: Profile) -> frozenset[Stream]:
    """Channels without which a scene of a profile cannot be drawn (SPEC §6.4)."""
    return frozenset(spec.stream for spec in STREAMS.values() if profile in spec.needed)


def channel_table() -> str:
    """The channels of both profiles, as SPEC §6.4 prints them."""
    lines = ["| stream kind | components, explicit | components, anchor |", "|---|---|---|"]
    for stream in CHANNEL_STREAMS:
        cells = (_cell(STREAMS[stream], profile) for profile in Profile)
        lines.append(f"| {stream.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cell(spec: StreamSpec, profile: Profile) -> str:
    if profile not in spec.profiles:
        return "not allowed"
    return f"{spec.profiles[profile] or 'd, 1..64'}" + (", needed" if profile in spec.needed else "")
