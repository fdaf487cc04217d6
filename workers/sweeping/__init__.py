"""Computes chunks of sweeps: each point gets the same numbers as a single job."""
