"""Sums of terms with exact coefficients, from which the families of potentials are built."""
