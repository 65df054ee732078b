"""For whoever tests a reader of `.scar` files: random valid scenes, and ways to damage files.

:mod:`~scarfmt.testing.mutators` damages the bytes of a file, reproducibly from a number;
:mod:`~scarfmt.testing.scenes` and :mod:`~scarfmt.testing.neural_scenes` make random quantised scenes;
:mod:`~scarfmt.testing.strategies` offers all of it to Hypothesis, and is the only module that imports it.
"""
