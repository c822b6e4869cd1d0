"""What attitudes tell of a model: coverage, heading error, plans."""
