"""Exact rational functions of the state, of letters, and of atoms: roots, exponentials, sines and their like.

An element is a quotient of polynomials over the integers. Each relation that is used (u^n = base of a root,
cos² + sin² = 1, sign² = 1) is true of the real functions that the generators stand for, wherever a formula
has a value: an element whose numerator is reduced to 0 *is* 0 there. The converse holds without atoms. No
formula divides by what is 0 all over the sphere.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from math import comb, lcm
from typing import TypeVar

from flint import Ordering, arb, fmpz_mpoly, fmpz_mpoly_ctx

from service.dynamics.defect.equations import operations_of
from service.dynamics.discovery.setting import (
    POTENTIAL_POINTER,
    STATE,
    VELOCITIES,
    FunctionTooLargeError,
    LetteredSetting,
    UndefinedFunctionError,
)
from service.dynamics.discovery.strata import Letters, by_powers, coefficients
from service.dynamics.equations.euler_poisson import rates_in
from service.dynamics.errors import ImpossibleInertiaError
from service.dynamics.formula.algebra import Algebra, DerivedOperations
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.parameters import MOMENTS, PI
from service.dynamics.formula.tape import Instruction, Recorder, Tape
from service.dynamics.verdict.exact_ring.generators import NoProofError

T = TypeVar("T")

ORDER = ("r", "q", "p", "g3", "g2", "g1")
"""The variables, the greatest first: a relation is solved for the greatest in it. Atoms are greater."""
MAX_TERMS = 20_000
"""Terms of a polynomial on the way, beyond which nothing is proved."""
MAX_DEGREE = 10_000
"""Exponents of powers beyond which nothing is proved: exact numbers of states are raised to them."""
MAX_POWER_BITS = 1 << 20
"""Bits of the coefficients of powers, beyond which nothing is proved."""


@dataclass(frozen=True, slots=True)
class Quotient:
    """numerator / denominator, without a common factor."""

    numerator: fmpz_mpoly
    denominator: fmpz_mpoly


@dataclass(frozen=True, slots=True)
class SolvedRelation:
    """A polynomial that is 0, solved for the power of one generator: initial · x^degree + … ."""

    polynomial: fmpz_mpoly
    index: int
    degree: int
    initial: fmpz_mpoly

    @property
    def is_monic(self) -> bool:
        """Whether division by the polynomial replaces x^degree everywhere."""
        return bool(self.initial.is_constant()) and abs(int(self.initial.leading_coefficient())) == 1


class Functions(DerivedOperations[Quotient]):
    """The field of rational functions of one question; an algebra for tapes, without derivatives."""

    def __init__(self, setting: LetteredSetting, tapes: Iterable[Tape]) -> None:
        tapes = [*tapes, *map(setting.tape, setting.moments)]
        atoms, powers, constants = 0, [1], dict[str, None]()
        for tape in tapes:
            for each in tape.instructions:
                if each.operation == "power" and each.number is not None and each.number.denominator > 1:
                    powers.append(each.number.denominator)
                    atoms += 1
                elif each.operation in ("call", "general_power"):
                    atoms += 2
                elif each.operation == "pi":
                    constants[PI] = None
        self.setting = setting
        self._root = lcm(*powers)
        # Later atoms are greater: their relations have lesser generators in them.
        self._free = list(range(atoms))
        names = [*(f"_u{k}" for k in range(atoms)), *ORDER, *setting.letters, *constants]
        self.ring: fmpz_mpoly_ctx = fmpz_mpoly_ctx.get(names, Ordering.lex)
        # In texts letters come first, then the variables in their usual order.
        self._written = fmpz_mpoly_ctx.get([*setting.letters, *constants, *STATE], Ordering.lex)
        self.first_letter = atoms + len(ORDER)
        self.atoms = atoms
        self._by_name = dict(zip(names, self.ring.gens(), strict=True))
        self._atoms: dict[tuple[str, str], int] = {}
        self.relations: list[SolvedRelation] = []
        g1, g2, g3 = (self._by_name[name] for name in ORDER[:2:-1])
        self.sphere = self.relation(g1**2 + g2**2 + g3**2 - 1)
        self.inputs = [self._polynomial(self._by_name[name]) for name in (*STATE, *setting.letters)]

    # --- elements -------------------------------------------------------------------

    def constant(self, value: Fraction) -> Quotient:
        """Return an exact number."""
        return Quotient(self.ring.constant(value.numerator), self.ring.constant(value.denominator))

    def pi(self) -> Quotient:
        """Return π, which no polynomial has as a zero."""
        return self._polynomial(self._by_name[PI])

    def add(self, left: Quotient, right: Quotient) -> Quotient:
        """Return left + right."""
        if left.denominator == right.denominator:
            return self._lowest(left.numerator + right.numerator, left.denominator)
        above = left.numerator * right.denominator + right.numerator * left.denominator
        return self._lowest(above, left.denominator * right.denominator)

    def negate(self, operand: Quotient) -> Quotient:
        """Return -operand."""
        return Quotient(-operand.numerator, operand.denominator)

    def multiply(self, left: Quotient, right: Quotient) -> Quotient:
        """Return left · right."""
        _require_room(min(len(left.numerator), len(right.numerator)))
        return self._lowest(left.numerator * right.numerator, left.denominator * right.denominator)

    def divide(self, left: Quotient, right: Quotient) -> Quotient:
        """Return left / right; raises UndefinedFunctionError if that is 0 all over the sphere."""
        if self.vanishes(right.numerator):
            raise UndefinedFunctionError("a formula divides by what is 0 wherever |γ| = 1")
        return self.multiply(left, Quotient(right.denominator, right.numerator))

    def power(self, base: Quotient, exponent: Fraction) -> Quotient:
        """Return base^exponent; of a fraction, that power of the root of the least common degree."""
        if exponent.denominator > 1:
            base = self._polynomial(self.ring.gens()[self._rooted(base)])
            exponent *= self._root
        if exponent < 0:
            return self.divide(self.constant(Fraction(1)), self.power(base, -exponent))
        n = exponent.numerator
        parts = (base.numerator, base.denominator)
        size, degree = max(map(len, parts)), max(int(each.total_degree()) for each in parts)
        bits = max((int(c).bit_length() for each in parts for c in each.coeffs()), default=0)
        # A number 1 has powers of one bit; of a sum of s terms they have at most so many as a product has.
        if degree * n > MAX_DEGREE or (bits > 1 and bits * n > MAX_POWER_BITS):
            raise NoProofError("a power larger than proofs handle")
        _require_room(comb(size + n - 1, n) if size > 1 else 1)
        return Quotient(base.numerator**n, base.denominator**n)

    def call(self, name: str, argument: Quotient) -> Quotient:
        """Return the function: an atom, or a quotient of two."""
        gens = self.ring.gens()
        if name in ("sin", "cos", "tan"):
            sine, cosine = self._circle(argument)
            above, below = self._polynomial(gens[sine]), self._polynomial(gens[cosine])
            return self.divide(above, below) if name == "tan" else above if name == "sin" else below
        if name in ("abs", "sign"):
            sign = self._atom("sign", argument)
            if sign is not None:
                self.relations.append(self.relation(gens[sign] ** 2 - 1))
            turned = self._polynomial(gens[self._known("sign", argument)])
            return turned if name == "sign" else self.multiply(turned, argument)
        self._atom(name, argument)
        return self._polynomial(gens[self._known(name, argument)])

    def _circle(self, argument: Quotient) -> tuple[int, int]:
        sine, gens = self._atom("sin", argument), self.ring.gens()
        if sine is not None:
            cosine = self._atom("cos", argument)
            assert cosine is not None
            self.relations.append(self.relation(gens[cosine] ** 2 + gens[sine] ** 2 - 1))
        return self._known("sin", argument), self._known("cos", argument)

    def _rooted(self, base: Quotient) -> int:
        root = self._atom("root", base)
        if root is not None:
            u = self.ring.gens()[root]
            self.relations.append(self.relation(base.denominator * u**self._root - base.numerator))
        return self._known("root", base)

    def _atom(self, name: str, argument: Quotient) -> int | None:
        """Return a new generator for a function of an argument, None if it has one."""
        key = (name, f"{argument.numerator}/{argument.denominator}")
        if key in self._atoms:
            return None
        self._atoms[key] = self._free.pop()
        return self._atoms[key]

    def _known(self, name: str, argument: Quotient) -> int:
        return self._atoms[name, f"{argument.numerator}/{argument.denominator}"]

    def _polynomial(self, numerator: fmpz_mpoly) -> Quotient:
        return Quotient(numerator, self.ring.constant(1))

    def _lowest(self, numerator: fmpz_mpoly, denominator: fmpz_mpoly) -> Quotient:
        _require_room(max(len(numerator), len(denominator)))
        if denominator.is_one():
            return Quotient(numerator, denominator)
        common = numerator.gcd(denominator)
        return Quotient(numerator / common, denominator / common)

    # --- reduction -------------------------------------------------------------------

    def relation(self, polynomial: fmpz_mpoly) -> SolvedRelation:
        """Return a polynomial as a relation for the greatest generator in it."""
        degrees = polynomial.degrees()
        index = next(k for k, degree in enumerate(degrees) if degree > 0)
        powers = by_powers(polynomial, index)
        degree = max(powers)
        return SolvedRelation(polynomial, index, degree, powers[degree])

    def reduced(
        self, polynomial: fmpz_mpoly, relations: Iterable[SolvedRelation] | None = None
    ) -> fmpz_mpoly:
        """Return the pseudo-remainder by relations, those of the atoms and the sphere if left out.

        0 only if the polynomial is 0 wherever the relations hold and their initials are not 0.
        """
        chosen = [*self.relations, self.sphere] if relations is None else [*self.relations, *relations]
        for each in sorted(chosen, key=lambda each: each.index):
            if not polynomial:
                break
            polynomial = pseudo_remainder(polynomial, each)
            _require_room(len(polynomial))
        return polynomial

    def vanishes(self, polynomial: fmpz_mpoly) -> bool:
        """Whether the polynomial is 0 wherever |γ| = 1, as far as the relations of atoms show."""
        return not self.reduced(polynomial)

    # --- the equations of motion ---------------------------------------------------------

    def value(self, tape: Tape) -> Quotient:
        """Return the function of a tape over the state and the letters."""
        return tape.evaluate(self, self.inputs)

    def read(self, tape: Tape, pointer: str) -> Quotient:
        """Return the same of a formula that was sent; what has no exact form is refused at ``pointer``."""
        try:
            return self.value(tape)
        except NoProofError as error:
            detail = (
                f"a formula with {error}: at most {MAX_TERMS} terms when it is multiplied out, and degrees"
            )
            raise FunctionTooLargeError(
                f"{detail} up to {MAX_DEGREE}, are accepted", pointer=pointer
            ) from error
        except UndefinedFunctionError as error:
            raise UndefinedFunctionError(error.message, pointer=pointer) from error

    def require_setting(self) -> None:
        """Refuse a potential without a value, and moments that are not positive for any letters."""
        setting, at = self.setting, (0,) * self.first_letter
        with suppress(FunctionTooLargeError):
            self.read(setting.tape(setting.potential), POTENTIAL_POINTER)
        for name, each in zip(MOMENTS, setting.moments, strict=True):
            with suppress(FunctionTooLargeError):
                value = self.read(setting.tape(each), f"/body/{name}")
                parts = [self.split(part).get(at) for part in (value.numerator, value.denominator)]
                signs = [0 if part is None else self.letters.sign(part) for part in parts]
                if not value.numerator or signs[0] * signs[1] < 0:
                    reason = f"{name} = {self.quotient_text(value)} is positive for no values of the letters"
                    raise ImpossibleInertiaError(reason, pointer=f"/body/{name}")

    def gradient(self, tape: Tape) -> tuple[Quotient, ...]:
        """Return the derivatives along p, q, r, g1, g2, g3."""
        jets = FirstOrderJets(self, len(STATE))
        variables = jets.variables(self.inputs[: len(STATE)])
        letters = [jets.seed(x, [None] * len(STATE)) for x in self.inputs[len(STATE) :]]
        return jets.gradient(tape.evaluate(jets, [*variables, *letters]))

    def rates(self) -> tuple[Quotient, ...]:
        """Return dp/dt, ..., dg3/dt by the Euler-Poisson equations."""
        slopes = self.gradient(self.setting.tape(self.setting.potential))
        return equations_of_motion(self, self.moments(), self.inputs, slopes)

    def moments(self) -> list[Quotient]:
        """Return A, B, C; raises NoProofError."""
        return [self.value(self.setting.tape(each)) for each in self.setting.moments]

    def polynomial_gradient(self, polynomial: fmpz_mpoly) -> list[Quotient]:
        """Return the derivatives of a polynomial without atoms along p, ..., g3."""
        return self.quotient_gradient(self._polynomial(polynomial))

    def quotient_gradient(self, value: Quotient) -> list[Quotient]:
        """Return the derivatives of a quotient of polynomials without atoms along p, ..., g3."""
        N, D = value.numerator, value.denominator
        places = [self.atoms + ORDER.index(name) for name in STATE]
        return [self._lowest(N.derivative(k) * D - N * D.derivative(k), D * D) for k in places]

    def along(self, gradient: Sequence[Quotient], rates: Sequence[Quotient]) -> Quotient:
        """Return the derivative in time of a function by its gradient."""
        total = self.constant(Fraction(0))
        for slope, rate in zip(gradient, rates, strict=True):
            if slope.numerator and rate.numerator:
                total = self.add(total, self.multiply(slope, rate))
        return total

    # --- texts and values ----------------------------------------------------------------

    def enclosed(self, polynomial: fmpz_mpoly, values: Mapping[str, arb]) -> arb:
        """Return the value of a polynomial without atoms at enclosed variables and letters."""
        tape = self.tape(polynomial)
        inputs = [values.get(name, arb.nan()) for name in tape.variables]  # those that it has are known
        return tape.evaluate(BallAlgebra(), inputs)

    def tape(self, polynomial: fmpz_mpoly) -> Tape:
        """Return a polynomial without atoms as a tape over the state and the letters, however long it is."""
        variables = (*STATE, *self.setting.letters)
        recorder = Recorder(variables)
        emit, names = recorder.emit, self.ring.names()[self.atoms :]
        places = {name: place for place, name in enumerate(variables)}
        total = emit(Instruction("constant", number=Fraction(0)))
        for exponents, coefficient in polynomial.terms():
            term = emit(Instruction("constant", number=Fraction(int(coefficient))))
            for name, exponent in zip(names, exponents[self.atoms :], strict=True):
                if exponent:
                    base = emit(Instruction("pi")) if name == PI else places[name]
                    power = emit(Instruction("power", base, number=Fraction(int(exponent))))
                    term = emit(Instruction("multiply", term, power))
            total = emit(Instruction("add", total, term))
        return recorder.whole(total)

    def omega_degree(self, value: Quotient) -> int:
        """Return the degree of the numerator in p, q, r."""
        places = [self.atoms + ORDER.index(name) for name in VELOCITIES]
        return max((sum(int(e[place]) for place in places) for e in value.numerator.monoms()), default=0)

    @property
    def letters(self) -> Letters:
        """The letters, and π, as those of a matrix; moments are positive."""
        names = self.ring.names()[self.first_letter :]
        positive = frozenset(k for k, name in enumerate(names) if name in (*MOMENTS, PI))
        return Letters(fmpz_mpoly_ctx.get(names, Ordering.lex), positive)

    def split(self, polynomial: fmpz_mpoly) -> dict[tuple[int, ...], fmpz_mpoly]:
        """Return the coefficients, in the letters, of the monomials in atoms and variables."""
        return coefficients(polynomial, self.letters.ring, slice(self.first_letter))

    def text(self, polynomial: fmpz_mpoly) -> str | None:
        """Return a polynomial as a formula, None if there are atoms in it."""
        if any(polynomial.degrees()[: self.atoms]):
            return None
        return str(polynomial.project_to_context(self._written))

    def quotient_text(self, value: Quotient) -> str:
        """Return a quotient without atoms as a formula."""
        above, below = self.text(value.numerator), self.text(value.denominator)
        if below == "1":
            return f"{above}"
        top = above if len(value.numerator) == 1 else f"({above})"
        return f"{top}/{below}" if value.denominator.is_constant() else f"{top}/({below})"


@dataclass(frozen=True, slots=True)
class FunctionQuestion:
    """A function, with what judges it: the exact field, and tapes for enclosures."""

    field: Functions
    tape: Tape
    is_late: Callable[[], bool]

    def rate(self) -> Quotient:
        """Return dI/dt; raises NoProofError where it is too large."""
        return self.field.along(self.field.gradient(self.tape), self.field.rates())

    def rate_ball(self, values: Mapping[str, arb]) -> arb:
        """Return an enclosure of dI/dt at an enclosed state, at the current precision."""
        balls, setting = BallAlgebra(), self.field.setting
        inputs = [values[name] for name in (*STATE, *setting.letters)]
        moments = [setting.tape(each).evaluate(balls, inputs) for each in setting.moments]
        slopes = gradient_balls(setting.tape(setting.potential), inputs)
        rates = equations_of_motion(balls, moments, inputs, slopes)
        total = arb(0)
        for slope, rate in zip(gradient_balls(self.tape, inputs), rates, strict=True):
            total += slope * rate
        return total


def gradient_balls(tape: Tape, inputs: Sequence[arb]) -> tuple[arb, ...]:
    """Return enclosures of the derivatives of a function along p, q, r, g1, g2, g3."""
    jets = FirstOrderJets(BallAlgebra(), len(STATE))
    letters = [jets.seed(x, [None] * len(STATE)) for x in inputs[len(STATE) :]]
    return jets.gradient(tape.evaluate(jets, [*jets.variables(inputs[: len(STATE)]), *letters]))


def equations_of_motion(
    field: Algebra[T], moments: Sequence[T], state: Sequence[T], gradient: Sequence[T]
) -> tuple[T, ...]:
    """Return the derivatives of p, ..., g3 in time; ``gradient`` has those of V along g1, g2, g3 last."""
    A, B, C = moments
    differences = [field.subtract(x, y) for x, y in ((B, C), (C, A), (A, B))]
    return rates_in(operations_of(field))((*moments, *differences), state[:6], gradient[3:])


def pseudo_remainder(polynomial: fmpz_mpoly, relation: SolvedRelation) -> fmpz_mpoly:
    """Return initial^k · polynomial minus a multiple of the relation, of a lower degree in its generator.

    A rational factor may be left out.
    """
    index, degree = relation.index, relation.degree
    if int(polynomial.degrees()[index]) < degree:
        return polynomial
    if relation.is_monic:
        return polynomial % relation.polynomial
    x = polynomial.context().gens()[index]
    tail = relation.polynomial - relation.initial * x**degree
    parts = by_powers(polynomial, index)
    tails = by_powers(tail, index)
    zero = polynomial.context().constant(0)
    top = max(parts)
    while top >= degree:
        lead = parts.pop(top, zero)
        if lead:
            parts = {power: relation.initial * part for power, part in parts.items()}
            for power, part in tails.items():
                place = top - degree + power
                parts[place] = parts.get(place, zero) - lead * part
            _require_room(sum(map(len, parts.values())))
        top -= 1
    rest = sum((part * x**power for power, part in parts.items()), zero)
    return rest.primitive()[1] if rest else rest


def _require_room(terms: int) -> None:
    if terms > MAX_TERMS:
        raise NoProofError("more terms than proofs handle")
