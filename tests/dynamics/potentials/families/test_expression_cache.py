"""A formula that was read before is not read again; each problem has a tape of its own."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError
from service.dynamics.potentials.families import written
from service.dynamics.potentials.families.written import expression_potential

TEXT = "a*g1 + b/g3^2 + A*g2"
numbers = st.fractions(-3, 3, max_denominator=50)


@given(numbers, numbers, st.fractions(1, 3, max_denominator=9))
def test_what_is_kept_is_what_is_read(a, b, moment):
    body, parameters = RigidBody(moment, None, Fraction(1)), {"a": a, "b": b}
    written._made.cache_clear()
    read = expression_potential(TEXT, parameters, body)
    kept = expression_potential(TEXT, parameters, body)
    assert written._made.cache_info().hits == 1
    assert (kept, kept.tree, kept.tape) == (read, read.tree, read.tape)
    assert kept.tape is not read.tape
    assert kept.tape.programs is not read.tape.programs


def test_other_numbers_are_other_potentials():
    body, other = (RigidBody(Fraction(moment), None, Fraction(1)) for moment in (2, 3))
    one = expression_potential(TEXT, {"a": Fraction(1), "b": Fraction(1)}, body)
    assert one != expression_potential(TEXT, {"a": Fraction(1), "b": Fraction(2)}, body)
    assert one != expression_potential(TEXT, {"a": Fraction(1), "b": Fraction(1)}, other)


def test_a_fault_is_told_each_time():
    for _ in range(2):
        with pytest.raises(FormulaError) as caught:
            expression_potential("a*g1 + c", {"a": Fraction(1)}, RigidBody(Fraction(2), None, Fraction(1)))
        assert caught.value.pointer == "/potential/expression"
