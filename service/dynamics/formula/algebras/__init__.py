"""The number types in which formulas are evaluated."""
