"""Table 1 of the paper: cases of the heavy body, each proved by residuals of the Euler-Poisson equations.

V = a g1 + b g2 + c g3. Residuals are reduced modulo the invariant relations of the
case to the zero expression; where the moments obey no equation they are symbols,
else they are rational numbers that obey it. That the motions are real is said by
signs at a point. Case 11 (Dokshevich 1970) is not proved here.
"""

from collections.abc import Callable, Sequence

import sympy

from tests.paper.forms import GAMMA, A, B, C, Number, is_zero, printed_rates

a, b, c, p, q, r, s, x, z = sympy.symbols("a b c p q r s x z")
G1, G2, G3 = GAMMA
MOMENTS = (A, B, C)
R = sympy.Rational


def residuals(
    moments: Sequence[Number],
    centre: Sequence[Number],
    omega: Sequence[sympy.Expr],
    gamma: Sequence[sympy.Expr],
    derivative: Callable[[sympy.Expr], sympy.Expr],
) -> list[sympy.Expr]:
    """Return (A p', B q', C r', gamma') of a motion less what (1) and (2) say."""
    torques, turning = printed_rates(moments, centre, omega, gamma)
    motion = [moment * derivative(w) for moment, w in zip(moments, omega, strict=True)]
    motion += [derivative(g) for g in gamma]
    return [left - right for left, right in zip(motion, torques + turning, strict=True)]


def test_table_1_hess():
    """Case 1: b = 0, A a² (B-C) = C c² (A-B); A a p + C c r = 0 is kept by (1): f' = c (A-B) q f/(A a)."""
    (Ap, _, Cr), _ = printed_rates(MOMENTS, (a, 0, c), (p, q, r), GAMMA)
    f, rate = A * a * p + C * c * r, a * Ap + c * Cr
    condition = A * a**2 * (B - C) - C * c**2 * (A - B)
    assert is_zero(rate - c * (A - B) / (A * a) * q * f - condition * q * r / (A * a))


def test_table_1_staude():
    """Case 2: omega = w gamma = const on the cone a(B-C) g2 g3 + b(C-A) g3 g1 + c(A-B) g1 g2 = 0."""
    g3 = -c * (A - B) * G1 * G2 / (a * (B - C) * G2 + b * (C - A) * G1)
    gamma = (G1, G2, g3)
    w_squared = (c * G2 - b * g3) / ((C - B) * G2 * g3)
    w = sympy.Symbol("w")
    torques, turning = printed_rates(MOMENTS, (a, b, c), [w * g for g in gamma], gamma)
    assert all(is_zero(torque.expand().subs(w**2, w_squared)) for torque in torques)
    assert all(is_zero(rate) for rate in turning)
    # Real: a positive w² at a rational point.
    point = {A: 3, B: 2, C: R(3, 2), a: 1, b: R(1, 2), c: R(1, 4), G1: 1, G2: -1}
    assert w_squared.subs(point) > 0


def test_table_1_bobylev_steklov():
    """Case 3: A = 2C, b = c = 0; q = 0, p = const, a g3 = C p r, a g1 = h - C p² - C r²/2, for any B, p, h.

    The motions of the paper, I3 = 0, are those with h = C p².
    """
    h = sympy.Symbol("h")
    gamma = ((h - C * p**2 - C * r**2 / 2) / a, G2, C * p * r / a)
    r_rate, g2_rate = -a * G2 / C, p * gamma[2] - r * gamma[0]

    def derivative(f: sympy.Expr) -> sympy.Expr:
        return sympy.diff(f, r) * r_rate + sympy.diff(f, G2) * g2_rate

    left = residuals((2 * C, B, C), (a, 0, 0), (p, sympy.Integer(0), r), gamma, derivative)
    assert all(is_zero(residual) for residual in left)
    areas = 2 * C * p * gamma[0] + C * r * gamma[2]
    assert is_zero(areas - 2 * C * p * (h - C * p**2) / a)


def test_table_1_goriachev():
    """Case 4: b = c = 0, A C = 8 (A-2B)(B-C), I3 = 0: q² of degree 4, r² of degree 2 in p.

    At A = 1, B = 61/100.
    """
    B = R(61, 100)
    Q = (
        -(16 * B - 9) / B**2 * p**4
        + (4 * B - 3) * (48 * B**2 - 44 * B + 9) / (2 * B**2 * (2 * B - 1)) * p**2
        - (4 * B - 3) ** 2 * (4 * B - 1) * (8 * B - 5) * (8 * B - 3) / (32 * B**2 * (2 * B - 1) ** 2)
    )
    S = -((16 * B - 9) ** 2) / (16 * B**2) * p**2 + (4 * B - 3) ** 2 * (4 * B - 1) * (16 * B - 9) / (
        32 * B**2 * (2 * B - 1)
    )
    h = -((4 * B - 3) ** 2) * (4 * B - 1) * (64 * B**2 - 56 * B + 9) / (32 * B * (2 * B - 1) * (16 * B - 9))
    moments = (1, B, 8 * B * (2 * B - 1) / (16 * B - 9))
    assert 8 * (1 - 2 * B) * (B - moments[2]) == moments[2]
    assert _is_motion_of_centre_on_axis(moments, Q, S, h, p, areas=0, at=R(1, 5))


def test_table_1_steklov():
    """Case 5: b = c = 0, I3 = 0, any moments: q² and r² are quadratic in p.

    At A = 1, B = 6/5, C = 2/5, h = 1.
    """
    B, C, h = R(6, 5), R(2, 5), sympy.Integer(1)
    D = 2 * B * C - 2 * B - 2 * C + 1
    Q = (C - 1) * p**2 / ((B - C) * (2 * B - 1)) + 2 * h * (2 * C - 1) / ((B - C) * D)
    S = -(B - 1) * p**2 / ((B - C) * (2 * C - 1)) - 2 * h * (2 * B - 1) / ((B - C) * D)
    assert _is_motion_of_centre_on_axis((1, B, C), Q, S, h, p, areas=0, at=R(1, 2))


def test_table_1_chaplygin():
    """Case 6: b = c = 0, 9A² - 18A(B+C) + 32BC = 0, I3 = h = 0: q², r² in powers of p^(2/3). At B = 31/20."""
    B, C = R(31, 20), R(189, 316)
    assert 9 - 18 * (B + C) + 32 * B * C == 0
    u, w = B * (C - 1) / (2 * B - 1), -C * (B - 1) / (2 * C - 1)
    w1 = 3 * (2 * B - 3) * (2 * B - 1) ** 2 * (16 * B - 9) / (8 * B**2 * (5 * B - 3))
    Q, S = s**2 * (1 + u * s**4) / (B * (B - C)), s**2 * (w1 + w * s**4) / (C * (B - C))
    assert _is_motion_of_centre_on_axis((1, B, C), Q, S, 0, s**3, areas=0, at=R(1, 5))


def test_table_1_kowalewski():
    """Case 7: b = c = 0, A C = 9 (A-2B)(B-C): q² of degree 3, r² of degree 2 in p.

    At A = 1, B = 5/8, C = 9/8.
    """
    B, C = R(5, 8), R(9, 8)
    assert 9 * (1 - 2 * B) * (B - C) == C
    Q = R(28, 625) - R(42, 125) * p - R(4, 25) * p**2 - R(16, 5) * p**3
    S = R(7, 225) + R(7, 45) * p - R(4, 9) * p**2
    assert _is_motion_of_centre_on_axis((1, B, C), Q, S, R(49, 1600), p, areas=None, at=R(-1, 100))


def test_table_1_grioli():
    """Case 8: b = 0, a² (B-C) = c² (A-B): regular precession. At A, B, C = 35, 26, 10, centre (3, 0, 4)."""
    A, B, C = moments = (35, 26, 10)
    assert 9 * (B - C) == 16 * (A - B)
    e, f = sympy.Matrix([R(3, 5), 0, R(4, 5)]), sympy.Matrix([R(4, 5), 0, R(-3, 5)])
    n, cosine, sine = sympy.symbols("n cosine sine")
    J, deviation = A + C - B, (A - C) * R(12, 25)
    axis = cosine * f + sine * sympy.Matrix([0, 1, 0])
    omega = n * (e + axis)
    gamma = n**2 / 5 * (J * axis + deviation * sine * e.cross(axis) - deviation * cosine * e)
    modulus = [sine**2 + cosine**2 - 1, n**4 - R(25) / (J**2 + deviation**2)]

    def derivative(f: sympy.Expr) -> sympy.Expr:
        return n * (sympy.diff(f, cosine) * sine - sympy.diff(f, sine) * cosine)

    left = residuals(moments, (3, 0, 4), list(omega), list(gamma), derivative)
    left.append(gamma.dot(gamma) - 1)
    assert all(sympy.reduced(g, modulus, n, sine, cosine)[1] == 0 for g in left)


def test_table_1_dokshevich():
    """Case 9 (1965): the body of Hess, its momentum M = (x, y, z) with x (y - eta x) = m, z² = Z(x), I3 = 0.

    The first axis is that of the centre; there omega = b1 (al x + y, x + k y, k z), b1 = -1, al = -3,
    k = -4: positive moments with the condition of case 1. eta = 2, m = -1.
    """
    al, k, eta, m = sympy.Integer(-3), sympy.Integer(-4), sympy.Integer(2), sympy.Integer(-1)
    assert 3 * eta**2 + (4 * al - 2 * k) * eta + al**2 - al * k - 1 == 0
    assert al * k > 1
    y = eta * x + m / x
    hh = m * (eta * k**2 + k**3 - 8 * eta - 4 * al + 6 * k) / (k * (k**2 + 4))
    z2 = -((al + eta) ** 2) * (eta**2 + 1) / ((al + eta) ** 2 + 1)
    z0, zm = 2 * ((al - k + 2 * eta) * m - k * (k * eta * m + m - hh)) / k**2, -(m**2)
    z_squared = z2 * x**2 + z0 + zm / x**2
    momentum = sympy.Matrix([x, y, z])
    # b1 = -1; gamma is scaled so that the centre is (1, 0, 0).
    omega = -sympy.Matrix([al * x + y, x + k * y, k * z])
    gamma = sympy.Matrix(
        [
            (al * x**2 + k * y**2 + k * z_squared) / 2 + x * y - hh,
            -(z2 * x**2 - zm / x**2) + (al - k) * x * y + y**2 - x**2,
            z * x * (al - k + 2 * eta),
        ]
    )

    def derivative(f: sympy.Expr) -> sympy.Expr:
        rate = x * z
        return sympy.diff(f, x) * rate + sympy.diff(f, z) * sympy.diff(z_squared, x) / (2 * z) * rate

    centre = sympy.Matrix([1, 0, 0])
    left = [*(momentum.applyfunc(derivative) - momentum.cross(omega) - gamma.cross(centre))]
    left += [*(gamma.applyfunc(derivative) - gamma.cross(omega)), momentum.dot(gamma)]
    assert all(is_zero(residual.expand().subs({z**2: z_squared, z**3: z * z_squared})) for residual in left)
    assert not sympy.diff(_square(gamma).expand().subs(z**2, z_squared).expand(), x)
    # z² > 0 between two positive x.
    assert z0 > 0
    assert z0**2 > 4 * z2 * zm


def _is_motion_of_centre_on_axis(
    moments: tuple[Number, Number, Number],
    Q: sympy.Expr,
    S: sympy.Expr,
    h: Number,
    p: sympy.Expr,
    *,
    areas: int | None,
    at: Number,
) -> bool:
    """Say whether q² = Q, r² = S is a motion: centre on the first axis, moments (1, B, C), p a power of s.

    gamma is scaled by a: its square must be the constant a² > 0.
    """
    _, B, C = moments
    (coordinate,) = Q.free_symbols
    speed = sympy.diff(p, coordinate)
    dQ, dS = sympy.diff(Q, coordinate) / speed, sympy.diff(S, coordinate) / speed
    gamma = (
        h - (p**2 + B * Q + C * S) / 2,
        q * ((1 - B) * p - C * (B - C) / 2 * dS),
        r * ((1 - C) * p + B * (B - C) / 2 * dQ),
    )

    def derivative(f: sympy.Expr) -> sympy.Expr:
        rate = sympy.diff(f, coordinate) * q * r / speed
        return (B - C) * (rate + (sympy.diff(f, q) * r * dQ + sympy.diff(f, r) * q * dS) / 2)

    def reduced(f: sympy.Expr) -> sympy.Expr:
        return sympy.together(f.expand().subs({q**2: Q, r**2: S}).expand().subs({q**2: Q, r**2: S})).expand()

    left = residuals(moments, (1, 0, 0), (p, q, r), gamma, derivative)
    if not all(is_zero(reduced(residual)) for residual in left):
        return False
    square = sympy.simplify(reduced(_square(gamma)))
    conserved = sympy.simplify(reduced(p * gamma[0] + B * q * gamma[1] + C * r * gamma[2]))
    is_real = square > 0 and Q.subs(coordinate, at) > 0 and S.subs(coordinate, at) > 0
    kept = conserved == areas if areas is not None else not conserved.free_symbols
    return bool(is_real) and bool(kept)


def _square(gamma: Sequence[sympy.Expr]) -> sympy.Expr:
    return gamma[0] ** 2 + gamma[1] ** 2 + gamma[2] ** 2
