"""Linear stability of periodic planar motions against leaving their plane."""
