"""Hypothesis strategies for formulas."""

from fractions import Fraction

from hypothesis import strategies as st

from service.dynamics.formula.tree import FUNCTIONS, Binary, Call, Negation, Number, Symbol, Tree

DECIMALS = st.builds(
    lambda digits, exponent: Number(Fraction(digits) * Fraction(10) ** exponent),
    st.integers(0, 10**25),
    st.integers(-40, 40),
)
SYMBOLS = st.builds(Symbol, st.sampled_from(["g1", "g2", "g3", "A", "B", "C", "pi", "a", "e", "e1", "_x"]))


def _grown(smaller: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    return st.one_of(
        st.builds(Negation, smaller),
        st.builds(Binary, st.sampled_from(["+", "-", "*", "/", "^"]), smaller, smaller),
        st.builds(Call, st.sampled_from(FUNCTIONS), smaller),
    )


VARIABLES = ("x", "y")
SMALL_NUMBERS = st.builds(Number, st.fractions(0, 9, max_denominator=9))
POWERS = st.builds(
    Binary,
    st.just("^"),
    st.builds(Symbol, st.sampled_from(VARIABLES)),
    st.builds(Number, st.fractions(-4, 4, max_denominator=3)),
)


def trees_of_variables(operators: str) -> st.SearchStrategy[Tree]:
    """Return small trees of the variables x and y, rational powers of them among the leaves."""
    return st.recursive(
        st.builds(Symbol, st.sampled_from(VARIABLES)) | POWERS | SMALL_NUMBERS,
        lambda smaller: st.one_of(
            st.builds(Negation, smaller),
            st.builds(Binary, st.sampled_from(operators), smaller, smaller),
            st.builds(Call, st.sampled_from(FUNCTIONS), smaller),
        ),
        max_leaves=8,
    )


TREES: st.SearchStrategy[Tree] = st.recursive(DECIMALS | SYMBOLS, _grown, max_leaves=25)
"""Any tree a text can have: numbers are decimals without a sign."""
