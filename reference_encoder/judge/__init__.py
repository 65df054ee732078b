"""Pictures of what was decided: the scene a decoder will show, and how far it is from the quality asked for."""
