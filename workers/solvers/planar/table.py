"""The tables of solver families, in the order in which they are tried.

Both tables are read from the top; the first row that fits holds. A family that does not take the motion, or
declines it, leaves it to the next one of its row.

Doubles of compiled code are the cheapest, and as exact as the tier of their kernel demands. Next come
elliptic functions, where the potential has three terms, then the way through poles that are not smooth, and
last the quadrature in balls, which has every motion.

No tier costs more than the next more accurate one: what its own kernel declines, it leaves to all that the
next one asks, in the same order.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Literal

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.motion import EnclosureMethod
from service.dynamics.problem import Accuracy, Method, Tier
from workers.solvers.certified.family import WayFamily
from workers.solvers.closed_form.family import ClosedFormFamily
from workers.solvers.compiled.family import CompiledFamily, CompiledTier
from workers.solvers.planar.duties import Family
from workers.solvers.quadrature.family import QuadratureFamily

Kind = Literal["any state", "periodic", "not periodic"]
"""The kind of a motion: integrated from any state; or planar, by the kind of its window."""
Grade = Literal["draft", "loose", "standard", "high", "certified"]
"""The tiers; ``loose`` is a tolerance that is looser than the promise of ``standard``."""
FamilyName = Literal["draft doubles", "standard doubles", "high doubles", "closed form", "way", "quadrature"]
Solver = FamilyName | Literal["integration"]
Enclosing = Literal["always", "where needed", "never"]
"""Whether samples are enclosed: ``where needed`` is where doubles do not keep the tolerance."""

COMPILED: Mapping[Solver, CompiledTier] = MappingProxyType(
    {"draft doubles": "draft", "standard doubles": "standard", "high doubles": "high"}
)
"""The tier of each kernel."""
FAMILIES: Mapping[FamilyName, Family] = MappingProxyType(
    {
        "draft doubles": CompiledFamily("draft"),
        "standard doubles": CompiledFamily("standard"),
        "high doubles": CompiledFamily("high"),
        "closed form": ClosedFormFamily(),
        "way": WayFamily(),
        "quadrature": QuadratureFamily(),
    }
)


@dataclass(frozen=True, slots=True)
class Row:
    """For motions of these kinds, by these methods, of these grades: who is asked, in this order."""

    kinds: tuple[Kind, ...]
    methods: tuple[Method, ...]
    grades: tuple[Grade, ...]
    asked: tuple[Solver, ...]

    @property
    def families(self) -> tuple[Family, ...]:
        """Return those among them that are asked with a window, which integration does not need."""
        return tuple(FAMILIES[name] for name in self.asked if name != "integration")


@dataclass(frozen=True, slots=True)
class EnclosureRow:
    """A rule for enclosing samples: for which methods and grades, when, and by what, in this order."""

    methods: tuple[Method, ...]
    grades: tuple[Grade, ...]
    when: Enclosing
    asked: tuple[EnclosureMethod, ...]


_PLANAR: tuple[Kind, ...] = ("periodic", "not periodic")
_ANY_METHOD: tuple[Method, ...] = ("auto", "quadrature", "integration", "both")
_FREE: tuple[Method, ...] = ("auto", "both")
"""Methods that leave the choice to the table."""
_ANY_GRADE: tuple[Grade, ...] = ("draft", "loose", "standard", "high", "certified")
_NOT_BY_DOUBLES: tuple[Grade, ...] = ("certified",)
_STANDARD: tuple[Grade, ...] = ("loose", "standard")
_BY_BALLS: tuple[Solver, ...] = ("way", "quadrature")
_DEARER: tuple[Solver, ...] = ("closed form", *_BY_BALLS)
_BY_HIGH: tuple[Solver, ...] = ("high doubles", *_DEARER)
_BY_STANDARD: tuple[Solver, ...] = ("standard doubles", *_BY_HIGH)
_BY_DRAFT: tuple[Solver, ...] = ("draft doubles", *_BY_STANDARD)

# fmt: off
FUNCTIONS_OF_TIME: tuple[Row, ...] = (
    #   motion              method             accuracy          asked, in this order
    Row(("any state",),     _ANY_METHOD,       _ANY_GRADE,       ("integration",)),
    Row(_PLANAR,            ("integration",),  _ANY_GRADE,       ("integration",)),
    Row(("not periodic",),  _ANY_METHOD,       _ANY_GRADE,       ("quadrature",)),
    Row(("periodic",),      ("quadrature",),   _ANY_GRADE,       _BY_BALLS),
    Row(("periodic",),      _FREE,             ("draft",),       _BY_DRAFT),
    Row(("periodic",),      _FREE,             _STANDARD,        _BY_STANDARD),
    Row(("periodic",),      _FREE,             ("high",),        _BY_HIGH),
    Row(("periodic",),      _FREE,             _NOT_BY_DOUBLES,  _DEARER),
)
"""The solvers that are asked for the motion as a function of time, by the first row that fits."""

ENCLOSURES: tuple[EnclosureRow, ...] = (
    #            method        accuracy         enclosed         asked, in this order
    EnclosureRow(_ANY_METHOD,  ("certified",),  "always",        ("elliptic", "integral")),
    EnclosureRow(_FREE,        _ANY_GRADE,      "where needed",  ("elliptic", "integral")),
    EnclosureRow(_ANY_METHOD,  _ANY_GRADE,      "never",         ()),
)
"""Whether samples are enclosed besides, and by what."""
# fmt: on


def grade_of(accuracy: Accuracy) -> Grade:
    """Return the grade of an accuracy: who is content with less than ``standard`` gets what is cheapest."""
    tier: Tier = accuracy.tier
    if tier == "standard" and accuracy.tolerance > TIER_TOLERANCES["standard"]:
        return "loose"
    return tier


@cache
def row_for(kind: Kind, method: Method, grade: Grade) -> Row:
    """Return the first row of FUNCTIONS_OF_TIME that fits; there is one for everything."""
    return next(
        row
        for row in FUNCTIONS_OF_TIME
        if kind in row.kinds and method in row.methods and grade in row.grades
    )


@cache
def enclosure_row_for(method: Method, grade: Grade) -> EnclosureRow:
    """Return the first row of ENCLOSURES that fits; there is one for everything."""
    return next(row for row in ENCLOSURES if method in row.methods and grade in row.grades)
