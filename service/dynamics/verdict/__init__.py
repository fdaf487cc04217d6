"""Decides whether a potential is admissible: proved, refuted by a point, or undecided with evidence."""
