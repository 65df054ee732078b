"""The decisions about a file: lattice, classes, layers, steps of each channel, contexts. Lambda is the price of a
bit."""
