"""Known cases are told by the exact conditions of the literature, on whatever axes they lie."""

from fractions import Fraction

import pytest

from service.dynamics.body import RigidBody
from service.dynamics.discovery.known import known_cases
from service.dynamics.potentials.families.written import expression_potential

CASES = [
    ((2, 2, 1), "-g1", ["kovalevskaya", "bobylev_steklov"]),
    ((2, 2, 1), "(g1 + 2*g2)^2/(g1 + 2*g2)*0 + g1 + g2 + 7", ["kovalevskaya"]),
    ((1, 2, 2), "g2 - g3", ["kovalevskaya"]),
    ((2, 1, 2), "g1 + g3", ["kovalevskaya"]),
    ((4, 4, 1), "a*g1", ["goriachev_chaplygin"]),
    ((4, 4, 1), "a*g1 + g3", []),
    ((2, "3/2", 1), "a*g1", ["bobylev_steklov"]),
    ((2, None, 1), "a*g1", ["bobylev_steklov"]),
    ((1, "3/2", 2), "a*g3", ["bobylev_steklov"]),
    ((2, "3/2", 1), "a*g3", []),
    ((3, 3, 2), "a*g3", ["lagrange"]),
    ((3, 2, 2), "a*g1", ["lagrange"]),
    ((3, "5/2", 2), "g1^2 + g2^2 + g3^2", ["euler"]),
    ((2, 2, 1), "a*g1 + g2^2", []),
    ((2, 2, 1), "sqrt(2 + g1)", []),
    (("2000000000001/1000000000000", 2, 1), "a*g1", []),
]


@pytest.mark.parametrize(("moments", "field", "names"), CASES)
def test_cases_are_told_by_their_conditions(moments, field, names):
    A, B, C = (None if each is None else Fraction(each) for each in moments)
    body = RigidBody(A, B, C, allow_unphysical=True)
    found = known_cases(body, expression_potential(field, {"a": Fraction(-1)}, body))
    assert [each.name for each in found] == names
    assert all(any(digit.isdigit() for digit in each.source) for each in found)
