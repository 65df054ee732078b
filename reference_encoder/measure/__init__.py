"""What an error costs: pictures of the scene, and sensitivities of every attribute."""
