from dataclasses import replace
from fractions import Fraction

import pytest

from service.dynamics.problem import (
    ClassicalMotion,
    PlanarMotion,
    StateMotion,
    TimeList,
    TimePeriods,
    TimeSpan,
)
from service.dynamics.sampling import exact_instants
from tests.support.planar import body, planar

UP = (Fraction(0), Fraction(0), Fraction(1))
MOTIONS = PlanarMotion(Fraction(1)), StateMotion(UP, UP), ClassicalMotion("grioli", UP)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_motion_is_of_one_kind_only(motion):
    problem = replace(planar(body(2, 1), "g1", MOTIONS[0]), motion=motion)
    assert problem.motion_as(type(motion)) is motion
    for other in {PlanarMotion, StateMotion, ClassicalMotion} - {type(motion)}:
        with pytest.raises(TypeError, match=other.__name__):
            problem.motion_as(other)


@pytest.mark.parametrize(
    "times", [TimeSpan(Fraction(0), Fraction(1), 5), TimePeriods(Fraction(2), 3), TimeList(UP)]
)
def test_there_are_as_many_instants_as_samples(times):
    assert len(exact_instants(times)) == times.samples
