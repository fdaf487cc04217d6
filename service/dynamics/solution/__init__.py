"""A computed motion as a function of time, with its evidence."""
