"""Writes trajectories and points in each supported media type."""
