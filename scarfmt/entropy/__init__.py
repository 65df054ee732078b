"""Entropy coding: symbols, the tables that code them, rANS, adaptive numbers (SPEC §8).

Codecs hand groups of symbols to an emitter: one that counts, to learn tables, or one that codes. Reading is the
mirror image. rANS itself is `constriction`'s coder with integer frequencies, defined in SPEC §8.2; a textbook version
beside it is the test.
"""
