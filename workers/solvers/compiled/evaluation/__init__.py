"""The formula's derivative along the curve, and p² on it, at many places at once."""
