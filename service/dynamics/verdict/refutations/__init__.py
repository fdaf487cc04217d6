"""Proves that a potential is not admissible: by a point, or by a jump across a line."""
