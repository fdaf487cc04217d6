"""The elliptic solution with p = x − k/x: one body.

Perhaps that of Dokshevich 1970, whose text was not obtained.
"""

from flint import arb, fmpq_poly

from service.dynamics.classical.protocol import (
    About,
    ClassicalCase,
    Constants,
    Number,
    Reduced,
    Relations,
    State,
    real_roots,
)

MINIMAL = (81, -9, -272, 176)
"""Minimal polynomial of B for A = 1, degree 0 first; the motion belongs to its largest root."""


def moments() -> tuple[tuple[arb, arb], ...]:
    """Return B and C, for A = 1, of the one body."""
    B = real_roots(fmpq_poly(list(MINIMAL)))[-1]
    return ((B, second(B)),)


def second(B: Number) -> Number:
    """Return C."""
    return (-176 * B * B + 776 * B + 144) / 603


def reduced(B: Number, C: Number) -> Reduced:
    """Return the motion of a body with A = 1 in x, u = q x/(x² + k), v = r x."""
    B2 = B * B
    k = 4268 * B2 / 36783 + 16156 * B / 36783 - (6443 + 0 * B) / 16348
    e2 = -(880 * B2 - 1888 * B + 771) / 27
    e1 = 143704 * B2 / 4941 - 265648 * B / 4941 + (25567 + 0 * B) / 1098
    em = -4355699529 * B2 / 1018917709 + 8251714250 * B / 1018917709 - (58732835085 + 0 * B) / 16302683344
    f1 = -341 * B2 / 9 + 626 * B / 9 - (497 + 0 * B) / 16
    f0 = -(737 * B2 / 549 - 2570 * B / 549 + (2637 + 0 * B) / 976)
    fm = 16236 * B2 / 3721 - 347144 * B / 40931 + (313551 + 0 * B) / 81862
    h = 26269 * B2 / 73566 - 332659 * B / 404613 + (584227 + 0 * B) / 1438624
    tau0 = -em / (e2 * k * k)
    zero = 0 * B
    constants = {"B": B, "C": C, "k": k, "e2": e2, "e1": e1, "em": em, "f1": f1, "f0": f0, "fm": fm}
    constants |= {"h": h, "tau0": tau0}
    return Reduced((-e2 * tau0, zero, e2), (fm, zero, f0, zero, f1), B - C, constants, _state, _relations)


def _state(k: Constants, x: Number, u: Number, v: Number) -> State:
    B, C, kk = k["B"], k["C"], k["k"]
    beta, tau = B - C, x * x
    p, q, r = x - kk / x, u * (x + kk / x), v / x
    dR = 2 * k["f1"] * x - 2 * k["fm"] / (tau * x)
    dQ = 4 * k["e2"] * tau * x + 2 * k["e1"] * x - 2 * k["em"] / (tau * x)
    Q = (x + kk / x) ** 2 * k["e2"] * (tau - k["tau0"])
    R = k["f1"] * tau + k["f0"] + k["fm"] / tau
    T1 = k["h"] - (p * p + B * Q + C * R) / 2
    T2 = u * ((x + kk / x) * (1 - B) * p - C * beta * x * dR / 2)
    T3 = r * ((1 - C) * p + B * beta * dQ * tau / (2 * (tau + kk)))
    return p, q, r, T1, T2, T3


def _relations(k: Constants, state: State) -> Relations:
    p, q, r, T1, T2, T3 = state
    kk = k["k"]
    # r² is linear in x² and 1/x², and so is p².
    tau = (r * r - k["f0"] - k["fm"] * (p * p + 2 * kk) / (kk * kk)) / (k["f1"] - k["fm"] / (kk * kk))
    x = (tau - kk) / p
    u = q * x / (tau + kk)
    _, _, _, S1, S2, S3 = _state(k, x, u, r * x)
    return {
        "p - x + k/x, x^2 by r^2": tau * (tau - 2 * kk - p * p) + kk * kk,
        "q^2 by x^2": u * u - k["e2"] * (tau - k["tau0"]),
        "gamma along the centre": T1 - S1,
        "gamma along the second axis": T2 - S2,
        "gamma along the third axis": T3 - S3,
    }


CASE = ClassicalCase(
    name="elliptic_x_minus_k_over_x",
    centre="axis",
    condition=None,
    ratios=moments,
    reduce=lambda setting: reduced(setting.B, setting.C),
    example={"A": 1, "a": 1},
    about=About(
        title="The elliptic solution with p = x - k/x",
        author="found by a search; perhaps that of A. I. Dokshevich, 1970",
        year=None,
        conditions=("b = c = 0", "176*(B/A)^3 - 272*(B/A)^2 - 9*B/A + 81 = 0, the largest root"),
        real="one body: B/A = 1.32009..., C/A = 1.42900...",
        relations=("p = x - k/x", "q^2 and r^2 are Laurent polynomials in x^2", "I3 = 0"),
        functions="elliptic",
        stability="linearly stable: all multipliers have the absolute value 1",
        source="candidate",
    ),
)
