"""Sizes that must agree in the networks of a file, so that its profile can be reconstructed (SPEC §9.5)."""

from __future__ import annotations

from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.container.header import HeaderFields
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import Malformed
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork
from scarfmt.scene.model import Codebooks, SceneModel

OUTPUTS_PER_SLOT = (1, 7, 3)
"""Outputs for each slot of the networks of a SCENE_MLP block, in their order: opacity, covariance, colour."""


def check_networks(
    fields: HeaderFields, model: SceneModel, decoder: QuantisedMlp | None, scene_mlps: tuple[QuantisedMlp, ...]
) -> None:
    """Check the networks against the profile.

    Args:
        model: checked; in the anchor profile it makes sure that there is a decoder.
        decoder: the latent decoder, None while no layer needs it.
        scene_mlps: networks of the SCENE_MLP block.

    Raises:
        Malformed: ``bad-mlp``.
    """
    if decoder is None:
        return
    if fields.profile == Profile.EXPLICIT:
        # Coefficients of each colour: all, or all but the first.
        coefficients = (fields.sh_degree + 1) ** 2 - (model.channel_index(Stream.COLOUR) is not None)
        _check_outputs(decoder, 3 * coefficients, "decoder")
        return
    if len(scene_mlps) != len(OUTPUTS_PER_SLOT):
        raise _bad(f"the anchor profile needs 3 networks, the file has {len(scene_mlps)}", "scene_mlps")
    if len({network.inputs for network in scene_mlps}) > 1:
        raise _bad("the three networks take different inputs", "scene_mlps")
    for network, outputs in zip(scene_mlps, OUTPUTS_PER_SLOT, strict=True):
        _check_outputs(network, outputs * fields.slots, "scene_mlps")
        # A feature, then the view direction, then perhaps the distance.
        if len(network.layers) != 2 or network.inputs - decoder.outputs not in (3, 4):
            raise _bad(f"a network of {len(network.layers)} layers and {network.inputs} inputs", "scene_mlps")


def check_index_network(model: SceneModel, books: Codebooks, network: IndexNetwork, grid: HashGrid | None) -> None:
    """Check the index network and its grid against the scene (SPEC §10.5).

    Raises:
        Malformed: ``bad-network`` where widths, stages or codebooks do not agree.
    """
    network.check(books, model.max_stages)
    inputs = network.inputs
    attributes = sum(model.channels[index].components for index in model.attributes)
    features = grid.width if grid is not None else 0
    wanted = (attributes, len(model.context.occupancies), features)
    if (inputs.attributes, inputs.depths, inputs.grid) != wanted:
        found = (inputs.attributes, inputs.depths, inputs.grid)
        message = f"inputs for {found} attributes, depths and grid features, the file has {wanted} (SPEC §10.5)"
        raise Malformed("bad-network", message, field="network")


def _check_outputs(network: QuantisedMlp, outputs: int, field: str) -> None:
    if network.outputs != outputs:
        raise _bad(f"a network gives {network.outputs} values, not {outputs}", field)


def _bad(message: str, field: str) -> Malformed:
    return Malformed("bad-mlp", f"{message} (SPEC §9.5)", field=field)
