"""Bobylev and Steklov 1896, of any areas integral: A = 2C, the centre on axis 1, q = 0, p constant."""

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
)


def condition(A: Number, _B: Number, C: Number, _a: Number, _c: Number) -> Number:
    """Return A − 2C."""
    return A - 2 * C


def reduced(C: Number, a: Number, p: Number, h: Number) -> Reduced:
    """Return the motion of a body with A = 1 = 2C in x = r, u = 1, v = C r' = −T2."""
    zero, one = 0 * C, 0 * C + 1
    e = h - C * p * p
    V = (a * a - e * e, zero, C * e - C * C * p * p, zero, -C * C / 4)
    return Reduced((one,), V, one / C, {"C": C, "p": p, "e": e}, _state, _relations)


def _state(k: Constants, r: Number, _u: Number, v: Number) -> State:
    C, p = k["C"], k["p"]
    return p + 0 * r, 0 * r, r, k["e"] - C * r * r / 2, -v, C * p * r


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, _, T3 = state
    return {
        "q": q,
        "p - constant": p - k["p"],
        "gamma along the third axis": T3 - k["C"] * k["p"] * r,
        "energy": T1 - k["e"] + k["C"] * r * r / 2,
    }


CASE = ClassicalCase(
    name="bobylev_steklov",
    centre="axis",
    condition=condition,
    reduce=lambda setting: reduced(
        setting.C, setting.a, setting.parameters["p"], setting.parameters["energy"]
    ),
    parameters={
        "p": "the constant component of the angular velocity along the centre; any number, 0 for a pendulum",
        "energy": "with e = energy - C*p^2: between -|a| and max(|a|, (a^2 + C^2*p^4)/(2*C*p^2)), the latter"
        " only where C*p^2 < |a|; without the ends and |a| itself. The areas integral is 2*C*p*e/a",
    },
    is_scaled=False,
    example={"A": 2, "B": "3/2", "C": 1, "a": 1, "p": "2/5", "energy": "53/200"},
    about=About(
        title="The solution of Bobylev and Steklov",
        author="D. K. Bobylev; V. A. Steklov",
        year=1896,
        conditions=("b = c = 0", "A = 2*C"),
        real="-|a| < energy - C*p^2 < |a|; and up to (a^2 + C^2*p^4)/(2*C*p^2) where C*p^2 < |a|",
        relations=("q = 0", "p is constant", "a*g3 = C*p*r"),
        functions="elliptic",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="proved",
    ),
)
