"""Ellipsoids fitted to readings: algebraic, consistent, orthogonal distance, choice of the model, subsampling."""
