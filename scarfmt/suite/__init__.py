"""Scoring any decoder against the conformance vectors, as conformance/PROTOCOL.md says.

:mod:`~scarfmt.suite.manifest` reads the vectors, :mod:`~scarfmt.suite.process` and :mod:`~scarfmt.suite.session` ask
the decoder, :mod:`~scarfmt.suite.protocol` parses what it prints, :mod:`~scarfmt.suite.compare` judges that,
:mod:`~scarfmt.suite.runner` decides what is asked and counts, :mod:`~scarfmt.suite.report` shows it.
"""
