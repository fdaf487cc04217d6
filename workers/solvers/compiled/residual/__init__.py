"""Residual evidence of the error of a function of time, by compiled code: equations at nodes and on discs."""
