"""Random quantised scenes with networks, as `scarfmt.testing` publishes them."""

from scarfmt.testing.neural_scenes import neural_scene
from scarfmt.testing.strategies import neural_scenes

__all__ = ["neural_scene", "neural_scenes"]
