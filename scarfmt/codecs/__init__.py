"""One module per sub-stream, its two directions side by side (SPEC §7).

Every codec is a pair of functions: `put_*` hands groups of symbols to an `Emitter`
(:mod:`scarfmt.entropy.emitters`), which counts or codes them; `get_*` takes the same groups, in the same order, from a
`SymbolReader` (:mod:`scarfmt.entropy.symbol_reader`). They are the definition: other engines
(:mod:`scarfmt.coding.engine`) read and write the same.
"""
