"""The families of potentials, given by coefficients or by formulas; they do not know each other."""
