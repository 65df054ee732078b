"""The writer of the vectors: blocks and symbols of the package's writer; tables, ROOT and pages of the suite's own.

The same scene gives the same bytes on every machine. :class:`.options.WriteOptions` makes files that SPEC.md allows and
the reference encoder never writes.
"""
