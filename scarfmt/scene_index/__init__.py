"""Scenes of several files (SPEC §17): the JSON index that lists them, and where they are.

document   what an index says, read and written
address    where an index is, and the files that it names
cutting    all files of a scene cut to their first layers
report     what `scarfmt inspect` says of an index
"""
