"""A place answers for its orbit without making it, wherever that is the same orbit."""

from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from tests.extremes.problems import SEPARATRIX
from tests.support.planar import body, formula
from workers.solvers.assembly.families import PeriodicPlace
from workers.solvers.orbits.near_rest import SlowOrbit
from workers.solvers.orbits.orbit import Libration, Rotation

NEAR = Fraction(round(SEPARATRIX * (1 + Fraction(1, 2**100)) * 2**164), 2**164)
"""Next to where the motion closes no more."""


@pytest.mark.parametrize(
    ("text", "lambda_", "kind"),
    [
        ("-g1", Fraction(4, 5), Rotation),
        ("-g1 + 1/(20*g3^2)", Fraction(1), Libration),
        (f"-g1 + ({NEAR.numerator}/{NEAR.denominator})*(g1^2 - g2^2)", Fraction(1), SlowOrbit),
    ],
)
def test_a_place_is_somewhere_on_its_orbit(text, lambda_, kind):
    rigid_body, motion = body(2, 1), PlanarMotion(lambda_)
    windows = find_windows(rigid_body, formula(text, rigid_body), motion)
    with ctx.workprec(REDUCTION_BITS):
        window = choose_window(windows, motion)
        place = PeriodicPlace(window, starting_point(window, motion))
        said = place.somewhere()
        assert isinstance(place.orbit, kind)
        there = place.orbit.somewhere()
        # The very same ball: the energy is worked out there, and its digits are those of the orbit's.
        assert (said.mid(), said.rad()) == (there.mid(), there.rad())
        assert place.orbit is place.orbit
