"""Judges whether a function is an integral, or f = 0 an invariant relation: proved, refuted, or undecided.

dI/dt along the Euler-Poisson equations is a rational function of the state, of letters and of atoms. It is
reduced by |γ| = 1, by I3 = 0, or by the closure of relations. Reduced to 0 it is a proof. Without atoms
|γ| = 1 and I3 = 0 are irreducible, and what is not reduced to 0 is refuted by a state: an enclosure of
dI/dt there without 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations

from flint import Ordering, arb, arb_mat, ctx, fmpz_mpoly, fmpz_mpoly_ctx

from service.dynamics.discovery.closure import (
    Closure,
    State,
    areas_polynomial,
    balls_of,
    closure_of,
    on_sphere,
    on_zero_areas,
    states,
    triangular_set,
)
from service.dynamics.discovery.functions import ORDER, Functions, Quotient, equations_of_motion
from service.dynamics.discovery.known import candidates
from service.dynamics.discovery.outcomes import (
    IntegralJudgement,
    Level,
    NotPolynomialError,
    StateCounterexample,
    UndefinedFunctionError,
)
from service.dynamics.discovery.setting import STATE, VELOCITIES, LetteredSetting
from service.dynamics.discovery.strata import Row, Substitution, kernel
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.verdict.exact_ring.layout import NoProofError
from service.dynamics.verdict.refutations.counterexample import DecimalBall, decimal_ball

FUNCTION_POINTER = "/function"
RELATIONS_POINTER = "/relations"
PRECISIONS = (128, 512, 2048)
"""Successive bits of enclosures."""
MAX_PRODUCTS = 400
"""Products of integrals among which a dependence is looked for."""
_ONE = Fraction(1)


@dataclass(frozen=True, slots=True)
class _Question:
    """A function, with what judges it: the exact field, and tapes for enclosures."""

    setting: LetteredSetting
    field: Functions
    tape: Tape
    is_late: Callable[[], bool]

    def rate(self) -> Quotient:
        """Return dI/dt; raises NoProofError where it is too large."""
        return self.field.along(self.field.gradient(self.tape), self.field.rates())

    def rate_ball(self, state: State) -> arb:
        """Return an enclosure of dI/dt at a state, at the current precision."""
        balls, values = BallAlgebra(), balls_of(state)
        inputs = [values[name] for name in (*STATE, *self.setting.letters)]
        moments = [self.setting.tape(each).evaluate(balls, inputs) for each in self.setting.moments]
        slopes = gradient_balls(self.setting.tape(self.setting.potential), inputs)
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


def judge_integral(
    setting: LetteredSetting,
    function: str,
    *,
    areas_zero: bool = False,
    relations: Sequence[str] = (),
    is_late: Callable[[], bool] = lambda: False,
) -> IntegralJudgement:
    """Return whether a function is constant along motions: along all, where I3 = 0, or on ``relations``.

    The widest of these is found that holds. With ``relations``, those with I3 = 0 are asked about only if
    ``areas_zero``, which then is one of the relations too.

    Raises
    ------
    FormulaError
        At ``/function`` or ``/relations/0``, ...
    UndefinedFunctionError
        The function has no value or no derivative at any state tried.
    NotPolynomialError, EmptyRelationsError
        The relations are no polynomials; no motion keeps them.
    """
    question, polynomials = _question(setting, function, relations, is_late)
    field = question.field
    levels: list[tuple[Level, Callable[[], Closure]]] = [("always", lambda: on_sphere(field))]
    if areas_zero or not relations:
        levels.append(("zero_areas", lambda: on_zero_areas(field)))
    if relations:
        known = [*polynomials, *([areas_polynomial(field)] if areas_zero else [])]
        levels.append(("relations", lambda: closure_of(field, known, field.rates(), is_late)))
    counterexample: StateCounterexample | None = None
    for level, close in levels:
        closure = close()
        holds, found = _judge(question, closure)
        if holds:
            judgement = IntegralJudgement("integral", "symbolic", level, counterexample)
            return _with_independence(question, closure, judgement)
        counterexample = found
    if counterexample is None:
        return IntegralJudgement("undecided", None)
    return IntegralJudgement("not_integral", "counterexample", counterexample=counterexample)


def judge_relation(
    setting: LetteredSetting,
    function: str,
    *,
    areas_zero: bool = False,
    is_late: Callable[[], bool] = lambda: False,
) -> IntegralJudgement:
    """Return whether f = 0 is an invariant relation: f' = μ f, always or where I3 = 0.

    Raises as :func:`judge_integral`.
    """
    question, _ = _question(setting, function, (), is_late)
    field = question.field
    value = field.value(question.tape)
    polynomial = _without_atoms(field, value.numerator, FUNCTION_POINTER)
    levels: list[tuple[Level, list[fmpz_mpoly]]] = [("always", [])]
    if areas_zero:
        levels.append(("zero_areas", [areas_polynomial(field)]))
    counterexample: StateCounterexample | None = None
    for level, others in levels:
        closure = triangular_set(field, [field.sphere.polynomial, *others, polynomial], is_late)
        holds, found = _judge(question, closure)
        if holds:
            judgement = IntegralJudgement("invariant_relation", "symbolic", level, counterexample)
            return replace(
                judgement,
                multiplier=_multiplier(question, value),
                except_where=_texts(field, closure.exceptions),
            )
        counterexample = found
    if counterexample is None:
        return IntegralJudgement("undecided", None)
    return IntegralJudgement("not_invariant", "counterexample", counterexample=counterexample)


def _question(
    setting: LetteredSetting, function: str, relations: Sequence[str], is_late: Callable[[], bool]
) -> tuple[_Question, list[fmpz_mpoly]]:
    tape = setting.tape(setting.read(function, FUNCTION_POINTER))
    pointers = [f"{RELATIONS_POINTER}/{number}" for number in range(len(relations))]
    others = [
        setting.tape(setting.read(text, pointer)) for text, pointer in zip(relations, pointers, strict=True)
    ]
    field = Functions(setting, [tape, setting.tape(setting.potential), *others])
    polynomials = [
        _without_atoms(field, field.value(each).numerator, pointer)
        for each, pointer in zip(others, pointers, strict=True)
    ]
    return _Question(setting, field, tape, is_late), polynomials


def _without_atoms(field: Functions, polynomial: fmpz_mpoly, pointer: str) -> fmpz_mpoly:
    if any(int(degree) for degree in polynomial.degrees()[: field.atoms]):
        raise NotPolynomialError(
            "a relation is a rational function, without roots and functions", pointer=pointer
        )
    return polynomial


# --- proofs and refutations -----------------------------------------------------------------


def _judge(question: _Question, closure: Closure) -> tuple[bool, StateCounterexample | None]:
    """Return whether dI/dt = 0 is proved where the relations hold, and a state that refutes it."""
    first, *others = PRECISIONS
    is_defined, found = _refute(question, closure, first)
    if found is not None:
        return False, found
    if not is_defined and not any(_refute(question, closure, bits)[0] for bits in others):
        raise UndefinedFunctionError(
            "the function, or its derivative, has no value at any of the states tried",
            pointer=FUNCTION_POINTER,
        )
    try:
        if not question.field.reduced(question.rate().numerator, closure.relations):
            return True, None
    except NoProofError:
        pass
    for bits in others:
        _, found = _refute(question, closure, bits)
        if found is not None:
            return False, found
    return False, None


def _refute(question: _Question, closure: Closure, bits: int) -> tuple[bool, StateCounterexample | None]:
    """Return whether there is a state at which dI/dt has a value, and one at which that is not 0."""
    is_defined = False
    with ctx.workprec(bits):
        for state in states(question.field, closure):
            if question.is_late():
                break
            rate = question.rate_ball(state)
            if not rate.is_finite():
                continue
            is_defined = True
            enclosed = decimal_ball(rate)
            if not rate.contains(0) and enclosed.excludes_zero:
                return True, _counterexample(question, state, enclosed)
    return is_defined, None


def _counterexample(question: _Question, state: State, rate: DecimalBall) -> StateCounterexample:
    letters = {name: str(state[name]) for name in question.setting.letters}
    if any(isinstance(state[name], arb) for name in STATE):
        decimals = [decimal_ball(each) for name, each in balls_of(state).items() if name in STATE]
        by_name = dict(zip((name for name in state if name in STATE), decimals, strict=True))
        texts = {name: each.mid for name, each in by_name.items()}
        radius = max((each.rad for each in decimals), key=arb)
    else:
        texts, radius = {name: str(state[name]) for name in STATE}, None
    omega, gamma = ([texts[name] for name in names] for names in (VELOCITIES, VARIABLES))
    return StateCounterexample(
        (omega[0], omega[1], omega[2]), (gamma[0], gamma[1], gamma[2]), radius, letters, rate
    )


def _multiplier(question: _Question, value: Quotient) -> str | None:
    """Return μ of f' = μ f if it is a polynomial in the state: exactly, or with |γ| = 1 put into f'."""
    field, rate = question.field, question.rate()
    reduced = Quotient(field.reduced(rate.numerator), rate.denominator)
    for each in (rate, reduced):
        quotient = field.divide(each, value)
        is_polynomial = not any(
            int(degree) for degree in quotient.denominator.degrees()[: field.first_letter]
        )
        if is_polynomial and field.text(quotient.numerator) is not None:
            return field.quotient_text(quotient)
    return None


# --- independence and names ------------------------------------------------------------------


def _with_independence(
    question: _Question, closure: Closure, judgement: IntegralJudgement
) -> IntegralJudgement:
    field = question.field
    exceptions = _texts(field, closure.exceptions) if judgement.holds == "relations" else ()
    judgement = replace(judgement, except_where=exceptions)
    minor = _minor(question, closure)
    if minor is not None:
        name = _name_of(question, closure)
        return replace(judgement, independent=True, minor=minor, name=name)
    products = _Products.of(question, closure)
    found = None if products is None else products.dependence()
    if found is None:
        return judgement
    return replace(judgement, independent=False, dependence=found[0], name=found[1])


def _minor(question: _Question, closure: Closure) -> DecimalBall | None:
    """Return an enclosed minor, without 0, of the derivatives of the relations, of H, I3 and I; or None."""
    setting, field = question.setting, question.field
    others = [setting.energy, *(() if _has_zero_areas(field, closure) else (setting.areas,))]
    tapes = [*(setting.tape(each) for each in others), question.tape]
    count = len(closure.relations) + len(tapes)
    places = [field.atoms + ORDER.index(name) for name in STATE]
    with ctx.workprec(PRECISIONS[0]):
        for state in states(field, closure):
            values = balls_of(state)
            inputs = [values[name] for name in (*STATE, *setting.letters)]
            rows = [
                [field.enclosed(each.polynomial.derivative(place), values) for place in places]
                for each in closure.relations
            ]
            rows += [list(gradient_balls(tape, inputs)) for tape in tapes]
            for chosen in combinations(range(len(STATE)), count):
                determinant = arb_mat([[row[column] for column in chosen] for row in rows]).det()
                enclosed = decimal_ball(determinant) if determinant.is_finite() else None
                if enclosed is not None and enclosed.excludes_zero:
                    return enclosed
            if question.is_late():
                break
    return None


def _has_zero_areas(field: Functions, closure: Closure) -> bool:
    return not field.reduced(areas_polynomial(field), closure.relations)


@dataclass(frozen=True, slots=True)
class _Products:
    """Products of integrals as polynomials, reduced by the same relations with one common factor."""

    field: Functions
    closure: Closure
    H: Quotient
    I3: Quotient | None
    function: Quotient

    @classmethod
    def of(cls, question: _Question, closure: Closure) -> "_Products | None":
        """Return them; None where a relation is not solved for a variable without roots."""
        setting, field = question.setting, question.field
        if not all(each.degree == 1 or each.is_monic for each in closure.relations):
            return None
        I3 = None if _has_zero_areas(field, closure) else field.value(setting.tape(setting.areas))
        return cls(field, closure, field.value(setting.tape(setting.energy)), I3, field.value(question.tape))

    def dependence(self) -> tuple[str, str | None] | None:
        """Return a polynomial in I, H and I3 that is 0, and the name of I if it is one of them; or None."""
        field, degree = self.field, max(self.field.omega_degree(self.function), 1)
        for highest in (1, 2):
            powers, values = self._powers(highest, highest * degree)
            for row in self._relations(values):
                names = [*field.letters.ring.names(), "I", "H", "I3"]
                whole = fmpz_mpoly_ctx.get(names, Ordering.lex)
                total = whole.constant(0)
                for k, entry in row.items():
                    total += entry.compose(*whole.gens()[:-3], ctx=whole) * whole.term(exp_vec=powers[k])
                others = [powers[k][-2:] for k in row if any(powers[k][-2:])]
                is_linear = highest == 1 and len(others) <= 1
                named: dict[tuple[tuple[int, ...], ...], str] = {
                    (): "geometric",
                    ((1, 0),): "energy",
                    ((0, 1),): "areas",
                }
                return str(total), named.get(tuple(others)) if is_linear else None
        return None

    def names(self, other: Quotient) -> bool:
        """Whether I is a multiple of another function plus a polynomial in H and I3."""
        degree = max(self.field.omega_degree(self.function), 1)
        _, values = self._powers(0, degree)
        rows = self._relations([self.function, other, *values])
        return any(0 in row and 1 in row for row in rows)

    def _powers(self, highest: int, degree: int) -> tuple[list[tuple[int, ...]], list[Quotient]]:
        """Return products I^k H^i I3^j, k ≤ ``highest``, up to a degree in the velocities.

        Before them their exponents, after those of the letters, which are 0.
        """
        field, own = self.field, max(self.field.omega_degree(self.function), 1)
        padding = (0,) * field.letters.ring.nvars()
        powers, values = list[tuple[int, ...]](), list[Quotient]()
        for k in range(highest + 1):
            for i in range((degree - k * own) // 2 + 1):
                for j in range(degree - k * own - 2 * i + 1 if self.I3 is not None else 1):
                    value = field.constant(_ONE)
                    for power, factor in ((k, self.function), (i, self.H), (j, self.I3)):
                        if power and factor is not None:
                            value = field.multiply(value, field.power(factor, Fraction(power)))
                    powers.append((*padding, k, i, j))
                    values.append(value)
                    if len(values) > MAX_PRODUCTS:
                        raise NoProofError("more products than a dependence is looked for among")
        return powers, values

    def _relations(self, values: Sequence[Quotient]) -> list[Row]:
        """Return the linear relations between functions, with coefficients in the letters."""
        field = self.field
        common = field.ring.constant(1)
        for each in values:
            common = common * each.denominator / common.gcd(each.denominator)
        entries: Row = {
            k: each.numerator * (common / each.denominator) for k, each in enumerate(values) if each.numerator
        }
        for relation in sorted(self.closure.relations, key=lambda each: each.index):
            if relation.is_monic:
                entries = {k: entry % relation.polynomial for k, entry in entries.items()}
            else:
                x = field.ring.gens()[relation.index]
                tail = relation.initial * x - relation.polynomial
                entries = Substitution(relation.index, tail, relation.initial).apply(entries)
        letters, rows = field.letters, dict[tuple[int, ...], Row]()
        for column, entry in entries.items():
            for place, coefficient in field.split(entry).items():
                rows.setdefault(place, {})[column] = coefficient
        return kernel(list(rows.values()), len(values), letters)


def _name_of(question: _Question, closure: Closure) -> str | None:
    field = question.field
    try:
        products = _Products.of(question, closure)
        rates = field.rates()
        for each in candidates(field) if products is not None else ():
            rate = field.along(field.quotient_gradient(each.value), rates)
            is_integral = not field.reduced(rate.numerator, closure.relations)
            if is_integral and products is not None and products.names(each.value):
                return each.name
    except NoProofError:
        pass
    return None


def _texts(field: Functions, polynomials: Sequence[fmpz_mpoly]) -> tuple[str, ...]:
    return tuple(text for text in map(field.text, polynomials) if text is not None)
