"""A whole problem: body, potential, motion, times, accuracy, method, outputs."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, TypeVar

from service.dynamics.body import RigidBody
from service.dynamics.numerics import Tier as Tier  # re-exported for users of problems
from service.dynamics.potentials.potential import Potential

Sign = Literal[-1, 1]
Method = Literal["auto", "quadrature", "integration", "both"]
Accept = Literal["proved", "undecided"]
"""Potentials accepted for planar motions: proved ones, or also undecided ones proved on the own curve."""
Output = Literal["period", "gamma", "omega", "invariants", "orientation", "stability"]


@dataclass(frozen=True, slots=True)
class StartAtEquator:
    """Start where g2 = 0, with the sign of the amplitude s."""

    s_sign: Sign = 1


@dataclass(frozen=True, slots=True)
class StartAtRest:
    """Start where p = r = 0, in the hemisphere of ``g2_sign``."""

    g2_sign: Sign = 1


@dataclass(frozen=True, slots=True)
class StartAtPoint:
    """Start at a given g1 inside the window."""

    g1: Fraction
    g2_sign: Sign = 1
    s_sign: Sign = 1


Start = StartAtEquator | StartAtRest | StartAtPoint


@dataclass(frozen=True, slots=True)
class PlanarMotion:
    """A motion with q = 0 and zero areas integral, on |g3| = λ |g1|^(C/A).

    Exactly one of ``lambda_`` (> 0) and ``nu`` (signed, nu = g3²/g1, A = 2C
    only) is given; with ``nu`` the sign of g1 is that of nu.
    """

    lambda_: Fraction | None
    nu: Fraction | None = None
    g1_sign: Sign = 1
    g3_sign: Sign = 1
    window: int | None = None
    start: Start | None = None

    def __post_init__(self) -> None:
        if (self.lambda_ is None) == (self.nu is None):
            raise ValueError("exactly one of lambda_ and nu is needed")

    @property
    def lambda_squared(self) -> Fraction:
        """λ², which is |nu|."""
        return abs(self.nu) if self.nu is not None else (self.lambda_ or Fraction(0)) ** 2

    @property
    def sign_of_g1(self) -> Sign:
        """The sign of g1: that of nu, where nu is given."""
        return self.g1_sign if self.nu is None else 1 if self.nu > 0 else -1


@dataclass(frozen=True, slots=True)
class StateMotion:
    """A motion from any initial state: omega = (p, q, r), gamma = (g1, g2, g3)."""

    omega: tuple[Fraction, Fraction, Fraction]
    gamma: tuple[Fraction, Fraction, Fraction]


Partial = tuple[Fraction | None, Fraction | None, Fraction | None]
"""A vector of which one component may follow from the others."""


@dataclass(frozen=True, slots=True)
class ClassicalMotion:
    """A motion of the catalogue of classical cases; what a case does not take has its default."""

    case: str
    centre: tuple[Fraction, Fraction, Fraction]
    """(a, b, c) of the potential a g1 + b g2 + c g3."""
    phase: Fraction = Fraction(0)
    direction: Sign = 1
    sign: Sign = 1
    solution: int | None = None
    p: Fraction | None = None
    energy: Fraction | None = None
    spin: Fraction | None = None
    omega: Partial | None = None
    gamma: Partial | None = None


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """``samples`` equidistant times from ``start`` to ``stop``, both included."""

    start: Fraction
    stop: Fraction
    samples: int


@dataclass(frozen=True, slots=True)
class TimePeriods:
    """``samples`` equidistant times over ``periods`` periods from 0, both ends included."""

    periods: Fraction
    samples: int


@dataclass(frozen=True, slots=True)
class TimeList:
    """The times themselves, in the order asked."""

    times: tuple[Fraction, ...]

    @property
    def samples(self) -> int:
        """The number of times."""
        return len(self.times)


Times = TimeSpan | TimePeriods | TimeList


Measure = Literal["absolute", "above 1", "relative"]
"""The size that a tolerance is compared with: an absolute error; one relative to the size of the variable's
group where that is above 1; one relative to it everywhere."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The requested accuracy of the six variables."""

    tolerance: float
    """Largest error allowed over the requested times, as ``measure`` says."""
    tier: Tier = "standard"
    bits: int = 64
    """Precision of the tier ``certified``: radii are at most 2^(8 − bits)."""
    budget_seconds: float | None = None
    """A budget that has not been turned into a tier yet."""
    measure: Measure = "absolute"


_Kind = TypeVar("_Kind", PlanarMotion, StateMotion, ClassicalMotion)


@dataclass(frozen=True, slots=True)
class Problem:
    """Everything a solver needs to know, exact."""

    body: RigidBody
    potential: Potential
    motion: PlanarMotion | StateMotion | ClassicalMotion
    time: Times
    accuracy: Accuracy
    method: Method
    outputs: tuple[Output, ...]
    accept: Accept = "proved"

    def motion_as(self, kind: type[_Kind]) -> _Kind:
        """Return the motion, which the caller knows to be of this kind; raises TypeError if it is not."""
        if not isinstance(self.motion, kind):
            raise TypeError(f"{kind.__name__} is needed, and the motion is a {type(self.motion).__name__}")
        return self.motion

    @property
    def wants_series(self) -> bool:
        """Tell whether any function of time is requested, and not only numbers of the whole motion."""
        return self.method == "both" or not set(self.outputs) <= {"period", "stability"}

    @property
    def tolerance(self) -> float:
        """The largest error allowed over the requested times; absolute for solvers: see :class:`Accuracy`."""
        return self.accuracy.tolerance
