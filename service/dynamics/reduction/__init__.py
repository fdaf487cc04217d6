"""Planar motions reduced to one variable: curve, radicand, turning points, windows."""
