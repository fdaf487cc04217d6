"""Dokshevich 1965: the bodies of Hess, with a momentum along the centre that is not zero."""

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    Setting,
    State,
)


def condition(A: Number, B: Number, C: Number, a: Number, c: Number) -> Number:
    """Return A a²(B − C) − C c²(A − B), the condition of Hess."""
    return A * a * a * (B - C) - C * c * c * (A - B)


def slope_equation(al: Number, k: Number) -> tuple[Number, Number, Number]:
    """Return the coefficients of the quadratic equation of eta, that of degree 0 first."""
    return al * al - al * k - 1, 4 * al - 2 * k, 3 + 0 * al


def ratios(B: Number, C: Number, ex: Number, ez: Number) -> tuple[Number, Number, Number]:
    """Return b1, al and k of a body with A = 1."""
    b1 = ex * ez * (1 - 1 / C)
    return b1, (ex * ex + ez * ez / C) / b1, 1 / (B * b1)


def reduced(B: Number, C: Number, ex: Number, ez: Number, eta: Number) -> Reduced:
    """Return the motion of a body with A = 1 in x, the momentum along the centre, and v = x z; m = −1."""
    b1, al, k = ratios(B, C, ex, ez)
    k2, m = k * k, 0 * B - 1
    hh = m * (eta * k2 + k2 * k - 8 * eta - 4 * al + 6 * k) / (k * (k2 + 4))
    z2 = -((al + eta) ** 2) * (eta * eta + 1) / ((al + eta) ** 2 + 1)
    z0 = 2 * ((al - k + 2 * eta) * m - k * (k * eta * m + m - hh)) / k2
    zero, one = 0 * B, 0 * B + 1
    constants = {"B": B, "C": C, "ex": ex, "ez": ez, "eta": eta, "m": m, "b1": b1, "al": al, "k": k}
    constants |= {"hh": hh, "z2": z2, "z0": z0}
    return Reduced((one,), (-one, zero, z0, zero, z2), -b1, constants, _state, _relations)


def _gamma(k: Constants, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number]:
    """Return T along e, f2 = (ez, 0, −ex) and f3 = (0, 1, 0)."""
    al, kk = k["al"], k["k"]
    along = (al * x * x + kk * y * y + kk * z * z) / 2 + x * y - k["hh"]
    second = -(k["z2"] * x * x + 1 / (x * x)) + (al - kk) * x * y + y * y - x * x
    third = z * x * (al - kk + 2 * k["eta"])
    return -k["b1"] * along, -k["b1"] * second, -k["b1"] * third


def _state(k: Constants, x: Number, _u: Number, v: Number) -> State:
    ex, ez = k["ex"], k["ez"]
    y, z = k["eta"] * x + k["m"] / x, v / x
    along, second, third = _gamma(k, x, y, z)
    p, q, r = x * ex + y * ez, z / k["B"], (x * ez - y * ex) / k["C"]
    return p, q, r, along * ex + second * ez, third, along * ez - second * ex


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, T2, T3 = state
    ex, ez = k["ex"], k["ez"]
    M1, M3 = p, k["C"] * r
    x, y, z = M1 * ex + M3 * ez, M1 * ez - M3 * ex, k["B"] * q
    along, second, third = _gamma(k, x, y, z)
    x2 = x * x
    return {
        "x*(y - eta*x) - m": x * (y - k["eta"] * x) - k["m"],
        "x^2*z^2 by x^2": x2 * z * z - (k["z2"] * x2 * x2 + k["z0"] * x2 - 1),
        "gamma along the centre": T1 * ex + T3 * ez - along,
        "gamma across the centre": T1 * ez - T3 * ex - second,
        "gamma along the second axis": T2 - third,
    }


def _reduce(setting: Setting) -> Reduced:
    B, C, ex, ez = setting.B, setting.C, setting.ex, setting.ez
    _, al, k = ratios(B, C, ex, ez)
    c0, c1, c2 = slope_equation(al, k)
    # Of both roots this one gives the real motion, for all bodies with A > B > C.
    return reduced(B, C, ex, ez, (-c1 + (c1 * c1 - 4 * c2 * c0).sqrt()) / (2 * c2))


CASE = ClassicalCase(
    name="dokshevich_1965",
    centre="plane",
    condition=condition,
    reduce=_reduce,
    is_descending=True,
    example={"A": 3, "B": 2, "C": "3/2", "a": 1, "c": 1},
    about=About(
        title="The solution of Dokshevich on the bodies of Hess",
        author="A. I. Dokshevich",
        year=1965,
        conditions=("b = 0", "A*a^2*(B - C) = C*c^2*(A - B)"),
        real="all bodies: B is between A and C",
        relations=("x*(y - eta*x) = m with the momenta x along the centre and y across it", "I3 = 0"),
        functions="elliptic",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="attribution",
    ),
)
