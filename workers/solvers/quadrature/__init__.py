"""Quadrature of planar motions: the one integral, its inversion, the dense output."""
