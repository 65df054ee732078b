"""What the models of a file must be like for its profile to be reconstructed (SPEC §9): sizes that must agree."""

from __future__ import annotations

from scarfmt.codecs.mlp import Network
from scarfmt.errors import Malformed
from scarfmt.header import HeaderFields
from scarfmt.model import SceneModel
from scarfmt.reader import SceneModels
from scarfmt.schema import Profile, Stream

# The latent channel has as many as the latent decoder has inputs.
_COMPONENTS = {
    Stream.POSITION_RESIDUAL: 3,
    Stream.SCALE: 3,
    Stream.ROTATION: 3,
    Stream.OPACITY: 1,
    Stream.COLOUR: 3,
    Stream.OFFSETS: 3,
}
ANCHOR_SCALES = 6
OUTPUTS_PER_SLOT = (1, 7, 3)
"""Of the networks of a SCENE_MLP block, in their order: opacity, covariance, colour."""


def check_models(fields: HeaderFields, models: SceneModels) -> None:
    """Check channels and networks against the profile.

    Raises:
        Malformed: ``bad-channel`` or ``bad-mlp``.
    """
    _check_channels(models.model)
    if fields.profile == Profile.EXPLICIT:
        if models.decoder is not None:
            _check_outputs(models.decoder, 3 * network_coefficients(fields.sh_degree, models.model), "decoder")
        return
    if len(models.scene_mlps) != len(OUTPUTS_PER_SLOT):
        raise _bad(f"the anchor profile needs 3 networks, the file has {len(models.scene_mlps)}", "scene_mlps")
    for network, outputs in zip(models.scene_mlps, OUTPUTS_PER_SLOT, strict=True):
        _check_outputs(network, outputs * fields.slots, "scene_mlps")
        features = network.inputs if models.decoder is None else models.decoder.outputs
        if len(network.layers) != 2 or (models.decoder and network.inputs - features not in (3, 4)):
            raise _bad(f"a network of {len(network.layers)} layers and {network.inputs} inputs", "scene_mlps")
    if len({network.inputs for network in models.scene_mlps}) > 1:
        raise _bad("the three networks take different inputs", "scene_mlps")


def network_coefficients(sh_degree: int, model: SceneModel) -> int:
    """Spherical-harmonic coefficients a colour that the latent decoder gives: all, or all but the first."""
    return int((sh_degree + 1) ** 2) - any(channel.stream == Stream.COLOUR for channel in model.channels)


def _check_channels(model: SceneModel) -> None:
    sizes = {**_COMPONENTS}
    if model.profile == Profile.ANCHOR:
        sizes[Stream.SCALE] = ANCHOR_SCALES
    for channel in model.channels:
        expected = sizes.get(channel.stream, channel.components)
        if channel.components != expected:
            message = f"{channel.stream.name} has {channel.components} components, not {expected} (SPEC §6.4)"
            raise Malformed("bad-channel", message, field="channels")
    if not any(channel.stream == Stream.SCALE for channel in model.channels):
        raise Malformed("bad-channel", "a scene without scales cannot be drawn (SPEC §9.2)", field="channels")


def _check_outputs(network: Network, outputs: int, field: str) -> None:
    if network.outputs != outputs:
        raise _bad(f"a network gives {network.outputs} values, not {outputs}", field)


def _bad(message: str, field: str) -> Malformed:
    return Malformed("bad-mlp", f"{message} (SPEC §9.5)", field=field)
