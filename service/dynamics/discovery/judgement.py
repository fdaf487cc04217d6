"""Judges whether a function is an integral, or f = 0 an invariant relation: proved, refuted, or undecided.

dI/dt along the Euler-Poisson equations is a rational function of the state, of letters and of atoms. It is
reduced by |γ| = 1, by I3 = 0, or by the closure of relations. Reduced to 0 it is a proof. Without atoms
|γ| = 1 and I3 = 0 are irreducible, and what is not reduced to 0 is refuted by a state: an enclosure of
dI/dt there without 0.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from flint import arb, ctx, fmpz_mpoly

from service.dynamics.discovery.closure import (
    Closure,
    State,
    areas_polynomial,
    balls_of,
    closure_of,
    essential,
    on_sphere,
    on_zero_areas,
    states,
    triangular_set,
)
from service.dynamics.discovery.functions import FunctionQuestion, Functions, Quotient
from service.dynamics.discovery.independence import with_independence
from service.dynamics.discovery.setting import (
    STATE,
    VELOCITIES,
    EmptyRelationsError,
    IntegralJudgement,
    LetteredSetting,
    Level,
    NotPolynomialError,
    StateCounterexample,
    UndefinedFunctionError,
)
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.verdict.exact_ring.generators import NoProofError
from service.dynamics.verdict.refutations import DecimalBall, decimal_ball

FUNCTION_POINTER = "/function"
RELATIONS_POINTER = "/relations"
PRECISIONS = (128, 512, 2048)
"""Successive bits of enclosures."""


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

    def followed() -> Closure:
        known = [*polynomials, *([areas_polynomial(field)] if areas_zero else [])]
        return closure_of(field, known, field.rates(), is_late)

    levels: list[tuple[Level, Callable[[], Closure]]] = [("always", lambda: on_sphere(field))]
    if areas_zero or not relations:
        levels.append(("zero_areas", lambda: on_zero_areas(field)))
    if relations:
        levels.append(("relations", followed))
    proved, counterexample = _widest(question, levels)
    if proved is not None:
        judgement = IntegralJudgement("integral", "symbolic", proved[0], counterexample)
        exceptions = _texts(field, proved[1].exceptions) if proved[0] == "relations" else ()
        return with_independence(question, proved[1], replace(judgement, except_where=exceptions))
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
    value = field.read(question.tape, FUNCTION_POINTER)
    polynomial = _without_atoms(field, value.numerator, FUNCTION_POINTER)
    simple = essential(field, polynomial)
    asked = question
    if simple.total_degree() < polynomial.total_degree():
        # The derivative of p² is 0 where p² is, whether or not motions keep p = 0.
        asked = replace(question, tape=field.tape(simple))
    own = [field.sphere.polynomial, simple]
    levels: list[tuple[Level, Callable[[], Closure]]] = [
        ("always", lambda: triangular_set(field, own, is_late))
    ]
    if areas_zero:
        levels.append(("zero_areas", lambda: triangular_set(field, [*own, areas_polynomial(field)], is_late)))
    try:
        proved, counterexample = _widest(asked, levels)
    except EmptyRelationsError as error:
        raise EmptyRelationsError(error.message, pointer=FUNCTION_POINTER) from error
    if proved is not None:
        level, closure = proved
        exceptions = _texts(field, closure.exceptions)
        return IntegralJudgement(
            "invariant_relation",
            "symbolic",
            level,
            counterexample,
            multiplier=_multiplier(question, value),
            except_where=exceptions,
        )
    if counterexample is None:
        return IntegralJudgement("undecided", None)
    return IntegralJudgement("not_invariant", "counterexample", counterexample=counterexample)


def _question(
    setting: LetteredSetting, function: str, relations: Sequence[str], is_late: Callable[[], bool]
) -> tuple[FunctionQuestion, list[fmpz_mpoly]]:
    tape = setting.tape(setting.read(function, FUNCTION_POINTER))
    pointers = [f"{RELATIONS_POINTER}/{number}" for number in range(len(relations))]
    others = [
        setting.tape(setting.read(text, pointer)) for text, pointer in zip(relations, pointers, strict=True)
    ]
    field = Functions(setting, [tape, setting.tape(setting.potential), *others])
    field.require_setting()
    polynomials = [
        _without_atoms(field, field.read(each, pointer).numerator, pointer)
        for each, pointer in zip(others, pointers, strict=True)
    ]
    return FunctionQuestion(field, tape, is_late), polynomials


def _without_atoms(field: Functions, polynomial: fmpz_mpoly, pointer: str) -> fmpz_mpoly:
    if any(int(degree) for degree in polynomial.degrees()[: field.atoms]):
        raise NotPolynomialError(
            "a relation is a rational function, without roots and functions", pointer=pointer
        )
    return polynomial


# --- proofs and refutations -----------------------------------------------------------------


def _widest(
    question: FunctionQuestion, levels: Sequence[tuple[Level, Callable[[], Closure]]]
) -> tuple[tuple[Level, Closure] | None, StateCounterexample | None]:
    """Return the first level at which dI/dt = 0 is proved, and a state that refutes the one before it.

    Without a proof the state refutes the last level, and is None where that is undecided.
    """
    counterexample: StateCounterexample | None = None
    for level, close in levels:
        try:
            closure = close()
        except NoProofError:
            counterexample = None
            continue
        holds, found = _judge(question, closure)
        if holds:
            return (level, closure), counterexample
        counterexample = found
    return None, counterexample


def _judge(question: FunctionQuestion, closure: Closure) -> tuple[bool, StateCounterexample | None]:
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


def _refute(
    question: FunctionQuestion, closure: Closure, bits: int
) -> tuple[bool, StateCounterexample | None]:
    """Return whether dI/dt has a value at some state, if one was found, and one at which that is not 0."""
    is_defined, has_states = False, False
    with ctx.workprec(bits):
        for state in states(question.field, closure):
            if question.is_late():
                break
            has_states = True
            rate = question.rate_ball(balls_of(state))
            if not rate.is_finite():
                continue
            is_defined = True
            enclosed = decimal_ball(rate)
            if not rate.contains(0) and enclosed.excludes_zero:
                return True, _counterexample(question, state, enclosed)
    return is_defined or not has_states, None


def _counterexample(question: FunctionQuestion, state: State, rate: DecimalBall) -> StateCounterexample:
    letters = {name: str(state[name]) for name in question.field.setting.letters}
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


def _multiplier(question: FunctionQuestion, value: Quotient) -> str | None:
    """Return μ of f' = μ f if it is a polynomial in the state: exactly, or with |γ| = 1 put into f'."""
    field = question.field
    # What is 0 all over the sphere divides nothing.
    with suppress(NoProofError, UndefinedFunctionError):
        rate = question.rate()
        reduced = Quotient(field.reduced(rate.numerator), rate.denominator)
        for each in (rate, reduced):
            quotient = field.divide(each, value)
            is_polynomial = not any(
                int(degree) for degree in quotient.denominator.degrees()[: field.first_letter]
            )
            if is_polynomial and field.text(quotient.numerator) is not None:
                return field.quotient_text(quotient)
    return None


def _texts(field: Functions, polynomials: Sequence[fmpz_mpoly]) -> tuple[str, ...]:
    return tuple(text for text in map(field.text, polynomials) if text is not None)
