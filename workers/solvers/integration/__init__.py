"""Integration of the six Euler-Poisson equations from any state."""
