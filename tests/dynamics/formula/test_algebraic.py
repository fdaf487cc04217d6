"""The zero test of algebraic numbers is a proof: true identities are zeros, near misses are not."""

import random
from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.formula.algebras.algebraic import (
    AlgebraicAlgebra,
    MoreBitsNeededError,
    NotAlgebraicError,
)
from service.dynamics.formula.parser import parse_located
from service.dynamics.formula.tape import compile_tape


def is_zero(text: str) -> bool:
    """Say whether a constant is zero, with as many bits as that takes."""
    tape, bits = compile_tape(parse_located(text).tree), 64
    while True:
        try:
            with ctx.workprec(bits):
                algebra = AlgebraicAlgebra()
                # No variable occurs.
                return algebra.is_zero(tape.evaluate(algebra, [algebra.constant(Fraction(0))] * 3))
        except MoreBitsNeededError as more:
            bits = max(more.bits, bits + 1)


IDENTITIES = (
    "sqrt(2)*sqrt(3)-sqrt(6)",
    "sqrt(3+2*sqrt(2))-1-sqrt(2)",
    "(2+sqrt(5))^(1/3)-(1+sqrt(5))/2",
    "((1+sqrt(5))/4)*(6-2*sqrt(5))-(sqrt(5)-1)",
    "1/(sqrt(3)-sqrt(2))-sqrt(3)-sqrt(2)",
    "abs(1-sqrt(2))+1-sqrt(2)",
    "exp(sqrt(8)-2*sqrt(2))-1",
    "pi*(sqrt(8)-2*sqrt(2))",
    "log(sqrt(4)/2)+sin(sqrt(12)-2*sqrt(3))",
    "(7/2)^(3/2)*(7/2)^(1/2)-49/4",
)


@pytest.mark.parametrize("text", IDENTITIES)
def test_identities_are_zeros_and_what_is_next_to_them_is_not(text):
    assert is_zero(text)
    for bits in (30, 300, 1000):
        assert not is_zero(f"({text})+1/2^{bits}")
        assert not is_zero(f"({text})-sqrt(3)/2^{bits}")


def test_sums_of_square_roots_that_agree_in_many_digits_differ():
    draws = random.Random(5)
    for _ in range(20):
        n = draws.randrange(10**6, 10**12)
        # √n + √(n+2) − 2 √(n+1) is about −n^(−3/2)/4; the squares of it all are 0.
        assert not is_zero(f"sqrt({n})+sqrt({n + 2})-2*sqrt({n + 1})")
        assert is_zero(f"(sqrt({n})+sqrt({n + 2}))^2-2*{n}-2-2*sqrt({n}*{n + 2})")


OF_THE_FIELD = (
    "pi-pi*exp(1)/exp(1)",
    "exp(sin(1/3))*(1+sin(1/3))-exp(sin(1/3))-sin(1/3)*exp(sin(1/3))",
    "exp(log(2)-1/3+1/3)-2",
    "log(exp(sqrt(2)/3))*3-sqrt(2)",
    "sqrt(2)*pi-pi*sqrt(2)",
    "(pi+exp(1))^2-pi^2-2*pi*exp(1)-exp(1)*exp(1)",
    "tan(log(3))*sqrt(pi)-sqrt(pi)*tan(log(3))",
)


@pytest.mark.parametrize("text", OF_THE_FIELD)
def test_numbers_made_of_functions_are_zero_by_the_rules_of_the_field(text):
    assert is_zero(text)
    assert not is_zero(f"({text})+1/2^30")


@pytest.mark.parametrize("text", ["exp(2)-exp(1)^2", "sin(1)^2+cos(1)^2-1", "log(6)-log(2)-log(3)"])
def test_transcendental_numbers_are_not_proved_zero(text):
    with pytest.raises(NotAlgebraicError):
        is_zero(text)


def test_transcendental_numbers_may_be_told_from_zero():
    assert not is_zero("exp(1)-2.718281828459045")


@pytest.mark.parametrize("text", ["1/(sqrt(8)-2*sqrt(2))", "(sqrt(2)-2)^(1/2)"])
def test_what_has_no_value_is_no_number(text):
    with pytest.raises(NotAlgebraicError):
        is_zero(text)
