"""The mathematics of a problem: body, potential, motion, verdict. No I/O, clock, log or framework."""
