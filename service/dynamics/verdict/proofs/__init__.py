"""Proves that a potential is admissible, and derives the energy from the proof."""
