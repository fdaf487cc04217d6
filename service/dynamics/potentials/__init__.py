"""Potentials V(g1, g2, g3): their families, terms and recognition."""
