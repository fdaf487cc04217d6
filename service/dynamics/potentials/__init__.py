"""Potentials V(g1, g2, g3), one file per family."""
