"""The parts of a case: conditions on body and centre, free parameters, relations, reduced motion, sources."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

from flint import arb

from service.dynamics.classical.reduced import Number, Reduced

CentrePlace = Literal["axis", "plane", "any"]
"""On a principal axis; in a principal plane and on no axis; anywhere."""
Form = Literal["loop", "steady", "hess"]
"""One coordinate between two zeros of its rate; a steady rotation; a momentum that never closes."""
Source = Literal["proved", "attribution", "candidate"]
"""``proved``: formulas and name are beyond doubt; ``attribution``: the formulas are proved, the name is
that of the case they look like; ``candidate``: the formulas are proved, who was the first is not known."""
Condition = Callable[[Number, Number, Number, Number, Number], Number]
"""A polynomial in A, B, C, and the components a and c of the centre, zero for bodies of the case."""
Ratios = Callable[[], tuple[tuple[arb, arb], ...]]
"""B/A and C/A of the only bodies of the case."""


@dataclass(frozen=True, slots=True)
class About:
    """The description of a case in a catalogue, for people."""

    title: str
    author: str
    year: int | None
    conditions: tuple[str, ...]
    real: str
    """The bodies and parameters for which there is a motion, in one order of the axes; any other is
    accepted."""
    relations: tuple[str, ...]
    functions: str
    stability: str
    source: Source


@dataclass(frozen=True, slots=True)
class Setting:
    """Body and centre in the order of axes of the case, with A = 1; centre (a, 0, c), a > 0, c ≥ 0."""

    B: arb
    C: arb
    a: arb
    c: arb
    parameters: Mapping[str, arb] = field(default_factory=dict)

    @property
    def strength(self) -> arb:
        """The distance of the centre."""
        return (self.a * self.a + self.c * self.c).sqrt()

    @property
    def ex(self) -> arb:
        """The first component of the direction of the centre."""
        return self.a / self.strength

    @property
    def ez(self) -> arb:
        """The third component of the direction of the centre."""
        return self.c / self.strength


@dataclass(frozen=True, slots=True)
class ClassicalCase:
    """A case of the catalogue."""

    name: str
    centre: CentrePlace
    condition: Condition | None
    """None if the moments are free, or given by ``ratios``."""
    example: Mapping[str, object]
    """Moments, centre and parameters of a motion."""
    about: About
    reduce: Callable[[Setting], Reduced] | None = None
    """The motion between two ends; None for other forms."""
    ratios: Ratios | None = None
    parameters: Mapping[str, str] = field(default_factory=dict)
    """Free parameters beside signs and phase, and their real ranges."""
    form: Form = "loop"
    solutions: int = 1
    """Bodies among which a field of the motion chooses."""
    is_scaled: bool = True
    """The motion is reduced in a unit of time of its own, and fitted to the centre."""
    is_descending: bool = False
    """Its axes are taken so that A > B > C."""

    @property
    def solved(self) -> int:
        """The moment that follows from the other two: the second in a plane, else the third."""
        return 1 if self.centre == "plane" else 2

    @property
    def fields(self) -> dict[str, str]:
        """The fields of a motion document that the case takes, with what they mean."""
        own = dict(self.parameters)
        if self.form == "loop":
            own |= {"phase": PHASE}
            own |= {} if self.name == "bobylev_steklov" else {"direction": DIRECTION}
            own |= {"sign": SIGN} if self.centre == "axis" else {}
        if self.solutions > 1:
            own |= {"solution": "1 or 2: which of the bodies, if more than one moment is left out"}
        return own


PHASE = (
    "where on its closed curve the motion is at time 0, 0 to 1: a share of the angle in which the coordinate"
    " of the curve is a cosine; 0 if left out"
)
DIRECTION = "-1 for the motion backwards in time; 1 if left out"
SIGN = "-1 for the motion turned by half a turn about the axis of the centre; 1 if left out"


def rational(number: arb) -> Fraction:
    """Return the middle of a ball, exact."""
    middle = number.mid().fmpq()
    return Fraction(int(middle.p), int(middle.q))
