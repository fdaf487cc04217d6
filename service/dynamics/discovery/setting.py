"""Settings of questions: moments and a potential with letters; and results of discovery as documents.

All formulas are of the grammar: in p, q, r, g1, g2, g3, the moments A, B, C and the client's parameters.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar, Literal, TypeVar

from service.dynamics.errors import DynamicsError, FormulaError, ImpossibleInertiaError
from service.dynamics.formula.parameters import MOMENTS, bind, require_parameter_names
from service.dynamics.formula.parser import parse, parse_located
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import (
    VARIABLES,
    Binary,
    Symbol,
    Tree,
    exact_tree,
    fold_tree,
    post_order,
    with_operands,
)
from service.dynamics.verdict.refutations import DecimalBall

Document = dict[str, object]
Level = Literal["always", "zero_areas", "relations"]
"""The motions along which a function is constant: all, those with I3 = 0, those on the relations sent."""
Tell = Callable[[float], None]
"""Is told how much of a search is done: from 0 to 1, in rising order."""
T = TypeVar("T")


def untold(_: float) -> None:
    """Tell nobody."""


def part_of(tell: Tell, before: float, share: float) -> Tell:
    """Return what is told how much of a part is done: of such a share of the whole, and so much before it."""
    return lambda done: tell(before + share * done)


def thirds_of(tell: Tell) -> tuple[Tell, Tell, Tell]:
    """Return the same for three equal parts."""
    return part_of(tell, 0.0, 1 / 3), part_of(tell, 1 / 3, 1 / 3), part_of(tell, 2 / 3, 1 / 3)


def steps_of(steps: Sequence[T], tell: Tell) -> Iterator[T]:
    """Yield steps, and tell after each how many of them are done."""
    for done, step in enumerate(steps, start=1):
        yield step
        tell(done / len(steps))


class NotPolynomialError(DynamicsError):
    """A potential that a search needs as a polynomial, and that is none."""

    code: ClassVar[str] = "not_polynomial"


class UndefinedFunctionError(DynamicsError):
    """A function that has no value, or no derivative, anywhere on the sphere or on the relations."""

    code: ClassVar[str] = "undefined_function"


class EmptyRelationsError(DynamicsError):
    """Relations that no motion keeps, or that could not be followed to all they imply."""

    code: ClassVar[str] = "empty_relations"


class FunctionTooLargeError(DynamicsError):
    """A formula that is too large when it is multiplied out."""

    code: ClassVar[str] = "too_many_terms"


class SearchTooLargeError(DynamicsError):
    """A search with more unknowns than are solved for."""

    code: ClassVar[str] = "search_too_large"


@dataclass(frozen=True, slots=True)
class StateCounterexample:
    """A state with |γ| = 1, on the level and the relations asked about, and a quantity there that is not 0.

    ``omega`` and ``gamma`` are exact ratios where ``radius`` is None, otherwise decimals within it.
    ``letters`` has the numbers that were put in for what was left free. ``rate`` encloses dI/dt, without 0.
    """

    omega: tuple[str, str, str]
    gamma: tuple[str, str, str]
    radius: str | None
    letters: Mapping[str, str]
    rate: DecimalBall

    def to_document(self) -> Document:
        """Return it as JSON members."""
        return {
            "state": {"omega": list(self.omega), "gamma": list(self.gamma), "radius": self.radius},
            "letters": dict(self.letters),
            "rate": {"mid": self.rate.mid, "rad": self.rate.rad},
        }


@dataclass(frozen=True, slots=True)
class IntegralJudgement:
    """The answer to whether a function is an integral, or whether f = 0 is an invariant relation.

    ``holds`` is the widest set of motions for which the answer was proved, None if for none. The
    ``counterexample`` refutes the next wider one, or the question itself. ``independent`` tells whether the
    function is functionally independent of the energy, the areas and |γ|²: proved by ``minor``, an enclosed
    determinant of derivatives, or refuted by ``dependence``, a polynomial in the function I, H and I3 that is
    0; None where neither was found. Where a factor in ``except_where`` is 0, nothing is claimed.
    """

    verdict: Literal["integral", "not_integral", "invariant_relation", "not_invariant", "undecided"]
    proof: Literal["symbolic", "counterexample"] | None
    holds: Level | None = None
    counterexample: StateCounterexample | None = None
    multiplier: str | None = None
    independent: bool | None = None
    minor: DecimalBall | None = None
    dependence: str | None = None
    name: str | None = None
    except_where: tuple[str, ...] = ()

    def to_document(self) -> Document:
        """Return it as JSON members."""
        counterexample, minor = self.counterexample, self.minor
        return {
            "verdict": self.verdict,
            "proof": self.proof,
            "holds": self.holds,
            "counterexample": None if counterexample is None else counterexample.to_document(),
            "multiplier": self.multiplier,
            "independent": self.independent,
            "minor": None if minor is None else {"mid": minor.mid, "rad": minor.rad},
            "dependence": self.dependence,
            "name": self.name,
            "except_where": list(self.except_where),
        }


@dataclass(frozen=True, slots=True)
class FoundIntegral:
    """A polynomial integral, with its name if it is a known one, and its degrees in ω and γ on |γ| = 1."""

    expression: str
    name: str | None
    omega_degree: int
    gamma_degree: int

    def to_document(self) -> Document:
        """Return it as JSON members."""
        degree = {"omega": self.omega_degree, "gamma": self.gamma_degree}
        return {"expression": self.expression, "name": self.name, "degree": degree}


@dataclass(frozen=True, slots=True)
class SpecialIntegrals:
    """Conditions on the free letters, each a formula that is 0, and all integrals where they hold.

    At ``unresolved`` conditions, which are solved for no letter, it was not found whether there are more.
    """

    conditions: tuple[str, ...]
    integrals: tuple[FoundIntegral, ...]
    is_resolved: bool = True

    def to_document(self) -> Document:
        """Return it as JSON members."""
        return {
            "conditions": list(self.conditions),
            "integrals": [each.to_document() for each in self.integrals],
            "resolved": self.is_resolved,
        }


@dataclass(frozen=True, slots=True)
class IntegralSearch:
    """All polynomial integrals up to a degree, without what depends on those before and on H, I3, |γ|².

    ``integrals`` are those for all values of the letters; ``special`` has the values at which there are
    more. Not ``is_complete``: there may be more special values, since the time was over.
    """

    integrals: tuple[FoundIntegral, ...]
    special: tuple[SpecialIntegrals, ...]
    unknowns: int
    is_complete: bool

    def to_document(self) -> Document:
        """Return it as JSON members."""
        return {
            "integrals": [each.to_document() for each in self.integrals],
            "special": [each.to_document() for each in self.special],
            "unknowns": self.unknowns,
            "complete": self.is_complete,
        }


@dataclass(frozen=True, slots=True)
class SpecialRatio:
    """A ratio A/C at which more polynomials are admissible than at others; ``potentials`` are the further."""

    ratio: Fraction
    dimension: int
    potentials: tuple[str, ...]

    def to_document(self) -> Document:
        """Return it as JSON members."""
        potentials = [{"expression": text} for text in self.potentials]
        return {"ratio": str(self.ratio), "dimension": self.dimension, "potentials": potentials}


@dataclass(frozen=True, slots=True)
class PotentialSearch:
    """A basis of the admissible polynomials up to a degree on the sphere, the constant among them.

    For a given ratio A/C, or for every ratio but A = C and those in ``ratios``.
    """

    potentials: tuple[str, ...]
    ratios: tuple[SpecialRatio, ...]

    @property
    def dimension(self) -> int:
        """The number of polynomials in a basis."""
        return len(self.potentials)

    def to_document(self) -> Document:
        """Return it as JSON members."""
        return {
            "potentials": [{"expression": text} for text in self.potentials],
            "dimension": self.dimension,
            "ratios": [each.to_document() for each in self.ratios],
        }


@dataclass(frozen=True, slots=True)
class AdmittingRatios:
    """The ratios A/C ≠ 1 for which a polynomial is admissible: ``all`` of them, or finitely many.

    ``others`` has polynomials in A, for the C given, with positive roots that are no ratios of integers.
    """

    all: bool
    ratios: tuple[Fraction, ...] = ()
    others: tuple[str, ...] = ()

    def to_document(self) -> Document:
        """Return it as JSON members."""
        return {
            "all": self.all,
            "ratios": [str(ratio) for ratio in self.ratios],
            "others": list(self.others),
        }


VELOCITIES = ("p", "q", "r")
STATE = (*VELOCITIES, *VARIABLES)
"""p, q, r, g1, g2, g3."""
POTENTIAL_POINTER = "/potential/expression"


@dataclass(frozen=True, slots=True)
class LetteredSetting:
    """A body and a potential, in which ``letters`` stand for any numbers; moments are positive.

    ``moments`` are formulas in the letters, ``potential`` one in g1, g2, g3 and the letters.
    """

    letters: tuple[str, ...]
    moments: tuple[Tree, Tree, Tree]
    potential: Tree
    numbers: Mapping[str, Fraction]
    """The parameters that have numbers."""

    def read(self, text: str, pointer: str) -> Tree:
        """Return a formula in the state, the letters and the moments; raises FormulaError at ``pointer``."""
        return _read(text, (*STATE, *self.letters), self.numbers, self._given, pointer)

    def tape(self, tree: Tree) -> Tape:
        """Return a tape over p, q, r, g1, g2, g3 and the letters."""
        return compile_tape(tree, (*STATE, *self.letters))

    @property
    def energy(self) -> Tree:
        """The energy H."""
        kinetic = substituted(parse("(A*p^2 + B*q^2 + C*r^2)/2"), self._given)
        return Binary("+", kinetic, self.potential)

    @property
    def areas(self) -> Tree:
        """The areas integral I3."""
        return substituted(parse("A*p*g1 + B*q*g2 + C*r*g3"), self._given)

    @property
    def _given(self) -> dict[str, Tree]:
        return dict(zip(MOMENTS, self.moments, strict=True))


def read_setting(
    moments: Mapping[str, str | Fraction],
    potential: str,
    parameters: Mapping[str, Fraction | None] | None = None,
) -> LetteredSetting:
    """Return the setting of a document.

    Parameters
    ----------
    moments
        ``A``, ``B``, ``C``: numbers, or formulas in each other and in free parameters (``"2*C"``). Those
        left out are letters.
    potential
        A formula in g1, g2, g3, the parameters and the moments.
    parameters
        Their numbers; None leaves a parameter free, as a letter.

    Raises
    ------
    FormulaError
        At ``/potential/expression`` or ``/body/A``, ...
    ParameterNameError
        A parameter cannot have its name: p, q, r are names of the state.
    ImpossibleInertiaError
        A number that is not positive.
    """
    parameters = parameters or {}
    require_parameter_names(parameters)
    for name in VELOCITIES:
        if name in parameters:
            reason = f"{name!r} cannot be a parameter: it is a component of the angular velocity"
            raise DynamicsError(reason, pointer=f"/potential/parameters/{name}")
    numbers = {name: value for name, value in parameters.items() if value is not None}
    free = [name for name in MOMENTS if name not in moments]
    letters = (*free, *(name for name, value in parameters.items() if value is None))
    given: dict[str, Tree] = {name: Symbol(name) for name in free}
    waiting = [name for name in MOMENTS if name in moments]
    while waiting:
        # A moment may be a formula in others, in any order, but not in a circle.
        ready = [name for name in waiting if not _names(moments[name]) & (set(waiting) - {name})]
        if not ready or any(name in _names(moments[name]) for name in ready):
            raise FormulaError(
                "moments are formulas in each other in a circle", pointer=f"/body/{waiting[0]}"
            )
        for name in ready:
            value = moments[name]
            if isinstance(value, Fraction) and value <= 0:
                raise ImpossibleInertiaError(
                    f"{name} = {value} is not positive; a moment of inertia is > 0", pointer=f"/body/{name}"
                )
            pointer = f"/body/{name}"
            given[name] = (
                exact_tree(value)
                if isinstance(value, Fraction)
                else _moment(_read(value, letters, numbers, given, pointer), letters, pointer)
            )
        waiting = [name for name in waiting if name not in ready]
    field = _read(potential, (*VARIABLES, *letters), numbers, given, POTENTIAL_POINTER)
    return LetteredSetting(letters, (given["A"], given["B"], given["C"]), field, numbers)


def substituted(tree: Tree, images: Mapping[str, Tree]) -> Tree:
    """Return the tree with names replaced by their images."""

    def build(_: int, node: Tree, operands: Sequence[Tree]) -> Tree:
        return images.get(node.name, node) if isinstance(node, Symbol) else with_operands(node, operands)

    return fold_tree(tree, build)


def _names(value: str | Fraction) -> set[str]:
    if isinstance(value, Fraction):
        return set()
    return {node.name for node in post_order(parse(value)) if isinstance(node, Symbol)}


def _moment(tree: Tree, letters: Sequence[str], pointer: str) -> Tree:
    for each in compile_tape(tree, letters).instructions:
        is_root = each.operation == "power" and each.number is not None and each.number.denominator > 1
        if is_root or each.operation in ("call", "general_power"):
            reason = "a moment is a rational function of letters, without roots and functions"
            raise FormulaError(reason, pointer=pointer)
    return tree


def _read(
    text: str,
    variables: Sequence[str],
    numbers: Mapping[str, Fraction],
    given: Mapping[str, Tree],
    pointer: str,
) -> Tree:
    try:
        located = parse_located(text)
        names = tuple(dict.fromkeys((*variables, *given)))
        tree = substituted(bind(located.tree, numbers, variables=names, positions=located.positions), given)
        # A constant part without a value is found where the moments are numbers.
        compile_tape(tree, variables)
    except FormulaError as error:
        raise error.at(pointer=pointer) from error
    return tree
