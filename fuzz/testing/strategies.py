"""Hypothesis strategies: valid scenes and files of every kind, and damaged files."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import strategies as st

from fuzz.testing.mutators import Mutant, mutate
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile

_SEEDS = st.integers(0, 2**32 - 1)


def quantised_scenes(max_anchors: int = 60, max_layers: int = 4) -> st.SearchStrategy[QuantisedScene]:
    """Small scenes of both profiles, coded by static tables."""
    return _built(random_scene, max_anchors, max_layers, 4)


def neural_scenes(max_anchors: int = 60, max_layers: int = 4) -> st.SearchStrategy[QuantisedScene]:
    """Small scenes of both profiles with predictors, an index network and a hash grid."""
    return _built(neural_scene, max_anchors, max_layers, 3)


def _built(
    make: Callable[..., QuantisedScene], max_anchors: int, max_layers: int, max_tiles: int
) -> st.SearchStrategy[QuantisedScene]:
    return st.builds(
        make,
        _SEEDS,
        st.sampled_from(Profile),
        anchors=st.integers(0, max_anchors),
        layers=st.integers(1, max_layers),
        tiles=st.integers(1, max_tiles),
    )


def scenes(max_anchors: int = 60, max_layers: int = 4) -> st.SearchStrategy[QuantisedScene]:
    """Small scenes of every kind."""
    return quantised_scenes(max_anchors, max_layers) | neural_scenes(max_anchors, max_layers)


def mutants() -> st.SearchStrategy[Mutant]:
    """Damaged files of random scenes."""
    return st.builds(mutate, scenes(20, 3).map(write_scene), _SEEDS)
