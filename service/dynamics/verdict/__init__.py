"""The verdict on a potential: proved, refuted by a point, or undecided with the evidence."""
