"""Pure mathematics: what the problem is. No I/O, clock, log or framework."""
