"""Which stretches of the loop a motion can fill: every zero of p², proved."""
