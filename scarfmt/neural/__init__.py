"""The integer networks of the entropy model: decoded context, predictors, hash grid, index network (SPEC §10).

This is the definition, in NumPy. Everything is an integer; floating point carries integers where that is provably
exact (SPEC §10.1).
"""
