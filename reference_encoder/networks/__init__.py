"""Training of the neural entropy model (encoder side; SPEC §10 is what it trains for)."""
