"""What an error costs: pictures of the scene, sensitivities of every attribute, and how good a result looks."""
