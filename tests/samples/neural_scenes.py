"""Random quantised scenes with networks, as `fuzz.testing` publishes them."""

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.strategies import neural_scenes

__all__ = ["neural_scene", "neural_scenes"]
