"""Reduces planar motions to one variable: curve, radicand, turning points, windows."""
