"""The homogeneous terms by their series, and by the integral of the general solution with a power for F."""

from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.coefficients import energy_of_B, energy_of_C, homogeneous_potential
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms import energy_of_log
from tests.conformance.energies import ball
from tests.support.planar import body

ENERGIES = {"B": energy_of_B, "C": energy_of_C, "log": energy_of_log}

CASES = [
    ("17/10", "B", 0),
    ("17/10", "B", 3),
    ("17/10", "C", 2),
    ("3/5", "B", 1),
    ("3/5", "C", 3),
    ("2", "log", 3),
    ("3", "log", 2),
    ("5/2", "log", 4),
    ("1/3", "log", 2),
    ("2/3", "log", 5),
]


@pytest.mark.parametrize(("alpha", "name", "n"), CASES)
def test_a_term_is_the_integral_of_a_power_of_w(alpha: str, name: str, n: int):
    """V1[F] has the energy -F(w); potentials of one energy differ by (A g1² + C g3²) G(g2)."""
    ratio = Fraction(alpha)
    rigid_body = body(ratio, 1)
    term = homogeneous_potential(rigid_body, **{name: [Fraction(0)] * n + [Fraction(1)]})
    # λ^(2(n+1)) = (w / |A-C|^(α-1))^((n+1)/α), λ^(-2α(n+1)) = (w / |A-C|^(α-1))^(-(n+1)).
    is_power_of_B = name == "B" or (name == "log" and ratio > 1)
    power = (n + 1) / ratio if is_power_of_B else Fraction(-(n + 1))
    text = f"-(k)*(w/abs(A-C)^({ratio - 1}))^({power})"
    integral = general_potential(rigid_body, text, "0", {"k": ENERGIES[name](ratio, n)})
    with ctx.workprec(300):
        for g2 in (ball("1/3"), ball("-3/4")):
            quotients = [
                _difference(rigid_body, term, integral, angle, g2) for angle in ("1/3", "7/10", "6/5")
            ]
            for quotient in quotients[1:]:
                assert quotient.overlaps(quotients[0])
                # 300 bits are 90 digits; the sums and the integral lose less than 20 of them.
                assert (quotient - quotients[0]).abs_upper() < arb("1e-70")


def _difference(rigid_body: RigidBody, term: Potential, integral: Potential, angle: str, g2: arb) -> arb:
    """Return (V - V1)/Q at the given angle on the circle of latitude g2."""
    radius = (1 - g2**2).sqrt()
    g1, g3 = radius * ball(angle).cos(), radius * ball(angle).sin()
    Q = ball(rigid_body.A) * g1**2 + ball(rigid_body.C) * g3**2
    return (term.value_ball(g1, g2, g3) - integral.value_ball(g1, g2, g3)) / Q
