"""The expected results of a vector, computed from its scene: `expect.json` and the files beside it."""
