"""Formulas as mechanicians write them: LaTeX and MathML, simplified where there is time."""
