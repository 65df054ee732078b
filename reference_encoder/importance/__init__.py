"""The cost of errors: pictures of the scene, and sensitivities of every attribute."""
