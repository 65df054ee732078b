"""What a file holds: lattice, classes, layers, steps of each channel, contexts; everything priced by lambda."""
