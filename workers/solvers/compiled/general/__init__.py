"""Motions from any state: Taylor series of the six equations, their values, and what they leave of these."""
