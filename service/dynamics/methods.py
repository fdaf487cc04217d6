"""The names of what computes a motion, for those who compute none."""

from typing import Literal

SolvedBy = Literal["quadrature", "integration"]
Tier = Literal["draft", "standard", "high", "certified"]
"""Grades of accuracy, see :mod:`service.dynamics.accuracy`."""
