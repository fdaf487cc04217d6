"""Time as a function of the phase, what its series leave out, and samples at times."""
