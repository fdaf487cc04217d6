"""NaN and infinities pass no bound; no comparison of an error is written so that they could."""

import ast
from collections.abc import Iterator
from fractions import Fraction
from itertools import permutations
from math import inf, isnan, nan, ulp
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import service
import workers
from service.dynamics.numerics import is_within, largest, printed_error

ERRORS = {
    *("error", "claim", "defect", "drift", "departure", "disagreement", "distance"),
    *("reached", "tail", "change", "uncertain", "miss"),
}
"""In the names of numbers that must not be large."""
HARMLESS: dict[str, str] = {
    "angular_part/field.py: tail > TAIL_RELATIVE_SIZE * largest": "the integral itself stays NaN then",
    "atlas/parts.py: change < error": "a sum that is NaN is no improvement, and is not taken",
    "general/steps.py: tail > INVISIBLE_SHARE * top": "a run ends before a step whose series is not finite",
    "compiled/integrals.py: departure <= drift": "what is not known makes the drift NaN, and so it stays",
    "integration/run_pair.py: run.reached > 0.0": "a time, whose sign is asked",
    "integration/interface.py: run.reached > 0.0": "the same",
    "solvers/errors.py: period.error >= 0.0": "its sign is asked, before it is held against the tolerance",
    "stability/assessment.py: change >= square": "either branch carries NaN on",
    "time_map/panels.py: tail > 0.25 * before": "series with NaN were left undecided before",
    "time_map/panels.py: tail * half > tolerance * (length + largest * half)": "the same",
}
"""Comparisons that NaN passes, with the reason why that does no harm."""
_RETURNED = "what is not below infinity has been returned as NaN before"
HARMLESS_MAXIMA: dict[str, str] = {
    "residual/residual.py: max(defect, size)": _RETURNED,
    "residual/residual.py: max(drift, far)": "of states that are explained, which those with NaN are not",
    "general/run_pair.py: max(defect, by_defect)": "of runs that hold, which those with NaN do not",
    "general/run_pair.py: max(drift, by_drift)": "the same",
    "residual/residual.py: max(drift, far, astray, long)": "the same",
    "compiled/motion.py: max(departure, abs(value - states[NODES + j, a]))": "of states that are finite",
    "compiled/motion.py: max(departure, far)": _RETURNED,
}
SOURCES = [
    *Path(service.__file__).parent.joinpath("dynamics").rglob("*.py"),
    *Path(workers.__file__).parent.rglob("*.py"),
]


@pytest.mark.parametrize("limit", [0.0, 1e-15, 1.0, inf])
@pytest.mark.parametrize("error", [nan, inf, -inf])
def test_what_is_not_finite_is_within_no_limit(error, limit):
    assert not is_within(error, limit)


def test_a_limit_of_nan_allows_nothing():
    assert not is_within(0.0, nan)


def test_finite_errors_are_compared():
    assert is_within(1e-15, 1e-15)
    assert is_within(1e300, inf)
    assert not is_within(2e-15, 1e-15)


def test_nan_is_the_largest_in_whatever_place():
    assert all(isnan(largest(errors)) for errors in permutations((nan, 1.0, inf, -inf)))
    assert largest([1.0, 3.0, 2.0]) == 3.0
    assert largest([]) == 0.0


def test_every_comparison_of_an_error_is_written_so_that_nan_fails_it():
    """``error <= limit``, of which ``not`` refuses: never ``error > limit``, which NaN passes by."""
    found = {place for path in SOURCES for place in _comparisons_that_nan_passes(path)}
    assert found == set(HARMLESS)


def test_no_largest_error_is_taken_by_what_drops_nan():
    found = {place for path in SOURCES for place in _maxima_that_drop_nan(path)}
    assert found == set(HARMLESS_MAXIMA)


@pytest.mark.parametrize("text", ["error > limit", "limit < abs(a.error)", "1.0 <= found.error_at(times)"])
def test_the_walk_sees_what_it_is_for(text):
    (compared,) = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Compare))
    assert _lets_nan_pass(compared)


@pytest.mark.parametrize("text", ["error <= limit", "limit >= errors[0]", "terror > 1", "not error < limit"])
def test_the_walk_leaves_alone_what_is_written_well(text):
    (compared,) = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Compare))
    assert not _lets_nan_pass(compared)


def _comparisons_that_nan_passes(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Compare) and _lets_nan_pass(node):
            yield f"{path.parent.name}/{path.name}: {ast.unparse(node)}"


def _maxima_that_drop_nan(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        is_builtin = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "max"
        if is_builtin and any(_is_an_error(part) for argument in node.args for part in _parts(argument)):
            yield f"{path.parent.name}/{path.name}: {ast.unparse(node)}"


def _parts(argument: ast.expr) -> list[ast.expr]:
    """Return what is compared: the argument, or what a comprehension makes."""
    return [argument.elt] if isinstance(argument, ast.GeneratorExp | ast.ListComp) else [argument]


def _lets_nan_pass(node: ast.Compare) -> bool:
    sides = [node.left, *node.comparators]
    larger = (
        left if isinstance(operator, ast.Gt | ast.GtE) else right
        for left, operator, right in zip(sides, node.ops, sides[1:], strict=False)
        if isinstance(operator, ast.Gt | ast.GtE | ast.Lt | ast.LtE)
    )
    return any(_is_an_error(side) for side in larger)


def _is_an_error(expression: ast.expr) -> bool:
    match expression:
        case ast.Call(func=ast.Name(id="abs" | "float"), args=[inner]):
            return _is_an_error(inner)
        case ast.Call(func=inner) | ast.Subscript(value=inner) | ast.UnaryOp(operand=inner):
            return _is_an_error(inner)
        case ast.BinOp(left=inner, op=ast.Mult() | ast.Div()):
            return _is_an_error(inner)
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return not name.isupper() and any(word.rstrip("s") in ERRORS for word in name.lower().split("_"))
    return False


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(min_value=0.0, max_value=1e300),
    st.fractions(min_value=-1, max_value=1),
)
def test_the_error_that_is_printed_is_that_of_the_decimal(value, error, share):
    exact = Fraction(value) + share * Fraction(error)
    printed = printed_error(value, error)
    assert abs(Fraction(repr(value)) - exact) <= Fraction(printed)
    # The shortest decimal is nearer than half a unit of the last place; two roundings upwards.
    assert printed <= error + 0.5 * ulp(value) + 2.0 * ulp(error + ulp(value))


def test_decimals_that_are_doubles_keep_their_errors():
    assert [printed_error(0.5, 1e-20), printed_error(0.0, 0.0), printed_error(-2.0, 0.0)] == [1e-20, 0.0, 0.0]
    assert printed_error(0.1, 0.0) > 5e-18  # 0.1 is 5.55e-18 less than its double
    assert isnan(printed_error(1.0, nan))
    assert printed_error(nan, 1.0) == 1.0
