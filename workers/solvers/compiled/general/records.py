"""The data of potentials and bodies that kernels need, as records."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.records import Instructions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Gradient(NamedTuple):
    """The gradient of a potential as operations on registers; see :mod:`.series`."""

    code: IntArray
    """Shape (operations, 4)."""
    constants: FloatArray
    gradient: IntArray
    """The registers of V_1, V_2, V_3, and for each whether it is a constant."""
    registers: int


class Models(NamedTuple):
    """Bodies and potentials of one structure: a formula, its gradient, and numbers of each model.

    The second constants and moments are those of a problem that rounded numbers might as well have meant.
    """

    program: Instructions
    """V and its gradient, see :class:`workers.solvers.compiled.evaluation.program.Program`."""
    slopes: IntArray
    gradient: IntArray
    registers: int
    """The gradient, as :class:`Gradient` has it."""
    constants: FloatArray
    """Constants of the program, shape (models, constants)."""
    slope_constants: FloatArray
    other_slope_constants: FloatArray
    """Constants of the gradient's operations, shape (models, constants)."""
    moments: FloatArray
    other_moments: FloatArray
    """A, B, C, B − C, C − A, A − B, shape (models, 6)."""


class Asked(NamedTuple):
    """The request to two runs: times, tolerances and limits."""

    first: float
    last: float
    """The times from ``first`` ≤ 0 to ``last`` ≥ 0."""
    fine: float
    coarse: float
    """Local tolerances of the runs."""
    max_steps: int
    collapsed: float
    """A step this much shorter than the longest one ends a run."""
    singular: float
    """Growth of the potential's gradient from the beginning of such a run that tells a singularity."""
    before_the_end: float
    """Share of the time of such a run of which nothing is asked."""
    tolerance: float
    safety: float
    """On the difference of the runs."""
    rounding: float
    """Error that the runs share, relative to the variables."""
    noise: float
    """Error of a step by rounding, relative to what it adds up."""
    tail: float
    """Truncation error of a step of the finer run, relative to the last terms: see :mod:`.growth`."""
    fine_defect: float
    coarse_defect: float
    """Largest residuals of a step in the equations, relative to the largest variable."""
    goal: float
    """Share of the error that the truncation of F may be."""
    finest: float
    """Least truncation asked for, beside variables of the size 1."""
    is_last: bool
    """Whether no finer runs follow if these are not accurate enough."""
