"""The names of what computes a motion; apart, since the store reads them and loads no arithmetic."""

from typing import Literal

SolvedBy = Literal["quadrature", "integration"]
Tier = Literal["draft", "standard", "high", "certified"]
"""Grades of accuracy, see :mod:`service.dynamics.accuracy`."""

NO_CROSS_CHECK = "no_cross_check"
"""Code of the warning that the second method could not follow the motion, so that nothing was compared."""
