"""The curve of a planar motion as a loop, and the formulas of a potential along it."""
