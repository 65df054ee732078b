"""Scene indices (SPEC §17), valid and not: what readers of them are tested on."""
