"""Random quantised scenes, as `fuzz.testing` publishes them."""

from fuzz.testing.scenes import FEATURES, LATENT, TILE_DEPTH, random_scene
from fuzz.testing.strategies import quantised_scenes

__all__ = ["FEATURES", "LATENT", "TILE_DEPTH", "quantised_scenes", "random_scene"]
