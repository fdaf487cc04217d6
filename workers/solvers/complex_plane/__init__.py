"""The curve of a planar motion for complex parameters, for bounds in doubles and for enclosures."""
