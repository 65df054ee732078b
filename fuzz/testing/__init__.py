"""For whoever tests a reader of `.scar` files: random valid scenes, and ways to damage files.

:mod:`~fuzz.testing.mutators` damages the bytes of a file, reproducibly from a number;
:mod:`~fuzz.testing.scenes` and :mod:`~fuzz.testing.neural_scenes` make random quantised scenes;
:mod:`~fuzz.testing.strategies` offers all of it to Hypothesis, and is the only module that imports it.
"""
