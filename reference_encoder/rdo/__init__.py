"""Rate-distortion optimisation: lattice, classes, layers, steps of each channel, contexts.

Lambda, squared picture error per bit, is the price of a bit."""
