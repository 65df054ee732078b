"""Scoring any decoder against the conformance vectors, as conformance/PROTOCOL.md says.

:mod:`.manifest` reads the vectors, :mod:`.process` asks the decoder, :mod:`.protocol` parses what it prints,
:mod:`.compare` judges that, :mod:`.runner` decides what is asked and counts, :mod:`.report` shows it.
"""
