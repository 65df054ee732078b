"""A decoder of whole files in Python's standard library, written from SPEC.md's text and made to be read beside it.

It refuses what SPEC §12 refuses, in its order, and is a hundred times slower than the package. Read ``static`` first:
``fields`` (bytes, rANS), ``numbers``, ``front`` (container), ``models``, ``tile``, ``positions`` and ``static`` decode
files of the explicit profile without codebooks. ``decoder`` adds SPEC-neural.md, with ``arithmetic``, ``context``,
``predictors``, ``hash_grid``, ``index_network`` and ``neural_indices``. ``work`` is the limit of §13.2, ``metadata``
and ``streaming`` are annotations, ``answers`` and ``container`` the conformance protocol.
"""
