"""The registry of block kinds: whole, and what readers and SPEC take from it."""

from __future__ import annotations

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.registry import BLOCKS, MODEL_BLOCKS, element_table
from scarfmt.container.registries import BlockKind, Profile
from scarfmt.scene.model import SceneModel


def test_every_kind_that_belongs_to_no_tile_is_registered() -> None:
    """In the order of a file's directory, in which the writer yields them."""
    assert list(BLOCKS) == [kind for kind in BlockKind if kind != BlockKind.TILE]
    assert all(kind == spec.kind for kind, spec in BLOCKS.items())


def test_what_is_required_says_where() -> None:
    """A block that must be there has layers in which it must."""
    assert all(spec.layers is not None for spec in MODEL_BLOCKS if spec.required)


def _layers(model: SceneModel) -> dict[BlockKind, list[int]]:
    return {spec.kind: sorted(spec.layers(model)) for spec in MODEL_BLOCKS if spec.layers is not None}


def test_blocks_stand_in_the_layers_that_first_need_them() -> None:
    """For both profiles; one of explicit Gaussians has no networks of view."""
    for profile in Profile:
        model = random_scene(5, profile).model
        found = _layers(model)
        assert found[BlockKind.LAYER] == list(range(1, len(model.layers) + 1))
        assert found[BlockKind.SCENE_MLP] == ([1] if profile == Profile.ANCHOR else [])
        staged = [number for number, row in enumerate(model.layers, start=1) if max(row.stages)]
        assert found[BlockKind.CODEBOOKS][:1] == staged[:1]


def test_the_table_of_elements_names_every_model_block() -> None:
    """Rule R-5.4-19."""
    assert all(f"{int(spec.kind)} {spec.kind.name}" in element_table() for spec in MODEL_BLOCKS)
