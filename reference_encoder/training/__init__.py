"""Training from photos: anchors, networks, quantiser and entropy model together, towards one progressive file."""
