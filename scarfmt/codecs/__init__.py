"""One module per sub-stream, its two directions side by side (SPEC §7).

Every codec is a pair of functions over the interface of :mod:`scarfmt.entropy.symbols`: `put_*` hands groups of
symbols to an `Emitter` (which counts them, or codes them), `get_*` takes the same groups, in the same
order, from a `SymbolReader`.
"""
