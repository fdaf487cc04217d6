"""The stretches of the loop that a motion can fill: every zero of p², proved."""
