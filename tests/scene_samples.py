"""Random quantised scenes, as `scarfmt.testing` publishes them."""

from scarfmt.testing.scenes import FEATURES, LATENT, TILE_DEPTH, random_scene
from scarfmt.testing.strategies import quantised_scenes

__all__ = ["FEATURES", "LATENT", "TILE_DEPTH", "quantised_scenes", "random_scene"]
