"""Chunks of sweeps: many points of one problem, each with the numbers of its own job."""
