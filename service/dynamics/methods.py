"""The names of what computes a motion; apart, since the store reads them and loads no arithmetic."""

from typing import Literal

SolvedBy = Literal["quadrature", "integration"]
Tier = Literal["draft", "standard", "high", "certified"]
"""Grades of accuracy, see :mod:`service.dynamics.accuracy`."""
