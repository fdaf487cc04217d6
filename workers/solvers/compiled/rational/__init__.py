"""Bodies with A = 2C in rational potentials: windows and periods from exact roots, for the last digit."""
