"""How well a set of attitudes determines the model: coverage, heading error, and plans of further attitudes."""
