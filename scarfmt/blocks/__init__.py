"""Model blocks: what a file sends besides tiles, each declared as data (SPEC §7.8-§7.11, §8.3, §10).

The registry says of each kind what it is called, when it is needed and how often it may come; reader, writer,
validator and `scarfmt dump` work from it.
"""
