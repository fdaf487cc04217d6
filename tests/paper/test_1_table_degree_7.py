"""Table 1 of the paper, case 10: exact arithmetic in the field of the moments, of degree 7."""

from functools import reduce

import pytest
from flint import arb, ctx, fmpq, fmpq_poly, fmpz_poly

MINIMAL = [-9568, 118960, -627920, 1823596, -3146990, 3227896, -1822945, 437511]
MODULUS = fmpq_poly(MINIMAL)
B = fmpq_poly([0, 1])

Element = fmpq_poly
Laurent = dict[int, Element]
"""Powers of s with coefficients in Q(B)."""


def test_table_1_konosevich_pozdnyakovich():
    """Case 10: b = c = 0, A = 1; p = p0 + s², q² and r² of degree 4 in s; B of degree 7, C = 4(2B-1)/(17B-8).

    (1) says dp/dt = (B-C) q r and a g = (h - (p² + B q² + C r²)/2, q G2, r G3) with, where ' is d/dp,
    G2 = (1-B) p - C (B-C) (r²)'/2, G3 = (1-C) p + B (B-C) (q²)'/2. Of (2) two identities in s are left.
    They are linear in h and in q² at s = 0, which follow from their terms of degree 0.
    """
    constants = _linear_solution([_residuals(u0, h) for u0, h in ((0, 0), (1, 0), (0, 1))])
    left = _residuals(*constants)
    assert all(not coefficient for residual in left for coefficient in residual.values())
    square = _square(*constants)
    assert [power for power, coefficient in square.items() if coefficient] == [0]


@pytest.mark.parametrize(("near", "s"), [("0.4119", "-1.28"), ("0.70818", "-0.13")])
def test_table_1_konosevich_pozdnyakovich_is_real(near, s):
    """Case 10: for two of the roots B the body exists and q², r², a² are positive at some s, in balls."""
    constants = _linear_solution([_residuals(u0, h) for u0, h in ((0, 0), (1, 0), (0, 1))])
    with ctx.workprec(200):
        roots = [root.real for root, _ in fmpz_poly(MINIMAL).complex_roots() if root.imag == 0]
        (root,) = [value for value in roots if abs(value - arb(near)) < arb("1e-3")]
        q_squared, r_squared = _squares(constants[0])
        values = [_value(f, root, arb(s)) for f in (q_squared, r_squared, _square(*constants))]
        assert all(value > 0 for value in values)
        moments = arb(1), root, _number(C, root)
        assert all(moment > 0 and 2 * moment < sum(moments, arb(0)) for moment in moments)


def _times(*factors: Element | int) -> Element:
    return reduce(lambda x, y: x * y % MODULUS, factors, fmpq_poly([1]))


def _over(numerator: Element, *factors: Element | int) -> Element:
    common, inverse, _ = _times(*factors).xgcd(MODULUS)
    return _times(numerator, inverse / common[0])


def _line(b: int, a: int) -> Element:
    return fmpq_poly([a, b])


C = _over(4 * _line(2, -1), _line(17, -8))
BETA = B - C
HALF = fmpq(1, 2)
TWO_B, SEVENTEEN, FIVE, NINE, ONE = _line(2, -1), _line(17, -8), _line(5, -2), _line(9, -4), _line(1, -1)
P0 = _over(
    -_times(TWO_B, TWO_B, SEVENTEEN, SEVENTEEN, fmpq_poly([-248, 1224, -1908, 949])),
    48 * B * B, ONE, ONE, FIVE, NINE, NINE,
)  # fmt: skip
P: Laurent = {0: P0, 2: fmpq_poly([1])}


def _squares(u0: Element | int) -> tuple[Laurent, Laurent]:
    """Return q² and r² with this number for B(B-C)q² at s = 0."""
    u1 = _over(
        _times(TWO_B, TWO_B, SEVENTEEN, SEVENTEEN, fmpq_poly([4, -16, 17]), fmpq_poly([28, -108, 97])),
        16 * B * B, ONE, ONE, FIVE, FIVE, NINE, NINE,
    )  # fmt: skip
    u2 = _over(_times(TWO_B, SEVENTEEN, fmpq_poly([-68, 354, -588, 319])), 24 * B, ONE, ONE, FIVE, NINE)
    u4 = _over(-_times(B, NINE), TWO_B, SEVENTEEN)
    w2 = _over(
        _times(TWO_B, TWO_B, TWO_B, SEVENTEEN, SEVENTEEN, fmpq_poly([16, -48, -54, 127])),
        12 * B * B * B, ONE, FIVE, NINE, NINE,
    )  # fmt: skip
    w3 = _over(-2 * _times(TWO_B, TWO_B, _line(3, -2), SEVENTEEN), B, B, FIVE)
    w4 = _over(4 * _times(ONE, TWO_B), B)
    U = {0: fmpq_poly([u0]) if isinstance(u0, int) else u0, 1: u1, 2: u2, 3: fmpq_poly([1]), 4: u4}
    return (
        {k: _over(u, B, BETA) for k, u in U.items()},
        {k: _over(w, C, BETA) for k, w in {2: w2, 3: w3, 4: w4}.items()},
    )


def _gamma(u0: Element | int, h: Element | int) -> tuple[Laurent, Laurent, Laurent]:
    """Return a g1, a g2/q, a g3/r."""
    q_squared, r_squared = _squares(u0)
    first = _sum(
        ({0: fmpq_poly([h]) if isinstance(h, int) else h}, 1),
        (_product(P, P), -HALF),
        (q_squared, -HALF * B),
        (r_squared, -HALF * C),
    )
    second = _sum((P, 1 - B), (_slope(r_squared), -HALF * _times(C, BETA)))
    third = _sum((P, 1 - C), (_slope(q_squared), HALF * _times(B, BETA)))
    return first, second, third


def _residuals(u0: Element | int, h: Element | int) -> tuple[Laurent, Laurent]:
    """Return d(a g2)/dt and d(a g3)/dt less what (2) says, divided by r and by q."""
    q_squared, r_squared = _squares(u0)
    first, second, third = _gamma(u0, h)
    return (
        _sum(
            (_product(_slope(q_squared), second), HALF * BETA),
            (_product(q_squared, _slope(second)), BETA),
            (_product(P, third), -1),
            (first, 1),
        ),
        _sum(
            (_product(_slope(r_squared), third), HALF * BETA),
            (_product(r_squared, _slope(third)), BETA),
            (first, -1),
            (_product(P, second), 1),
        ),
    )


def _square(u0: Element, h: Element) -> Laurent:
    """Return a²."""
    q_squared, r_squared = _squares(u0)
    first, second, third = _gamma(u0, h)
    return _sum(
        (_product(first, first), 1),
        (_product(q_squared, _product(second, second)), 1),
        (_product(r_squared, _product(third, third)), 1),
    )


def _linear_solution(at: list[tuple[Laurent, Laurent]]) -> tuple[Element, Element]:
    """Return the (u0, h) where the terms s⁰ of both residuals vanish, from (0, 0), (1, 0), (0, 1)."""
    origin, *units = [[residual.get(0, fmpq_poly([])) for residual in pair] for pair in at]
    (m11, m21), (m12, m22) = [[x - o for x, o in zip(unit, origin, strict=True)] for unit in units]
    determinant = _times(m11, m22) - _times(m12, m21)
    return (
        _over(_times(m12, origin[1]) - _times(m22, origin[0]), determinant),
        _over(_times(m21, origin[0]) - _times(m11, origin[1]), determinant),
    )


def _product(left: Laurent, right: Laurent) -> Laurent:
    total: Laurent = {}
    for i, x in left.items():
        for j, y in right.items():
            total[i + j] = total.get(i + j, fmpq_poly([])) + _times(x, y)
    return total


def _sum(*terms: tuple[Laurent, Element | fmpq | int]) -> Laurent:
    total: Laurent = {}
    for term, factor in terms:
        for power, x in term.items():
            total[power] = (total.get(power, fmpq_poly([])) + x * factor) % MODULUS
    return total


def _slope(f: Laurent) -> Laurent:
    """Return df/dp = (df/ds)/(2s)."""
    return {power - 2: x * fmpq(power, 2) for power, x in f.items() if power}


def _number(x: Element, root: arb) -> arb:
    return arb(0) + sum((arb(x[k]) * root**k for k in range(x.degree() + 1)), arb(0))


def _value(f: Laurent, root: arb, s: arb) -> arb:
    return sum((_number(x, root) * s**power for power, x in f.items()), arb(0))
