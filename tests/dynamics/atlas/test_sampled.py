"""Atlases of potentials without a formula: against the proved one of the same V, and single motions."""

from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.atlas import sampled_atlas as module
from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import seldom
from tests.support.planar import body, formula

# V = V1[F] + Q G with V1 = 0 where |g1| = |g3| = s and s² = (1 - g2²)/2, so that G = V(s, g2, s)/Q there. On
# a curve the energy is -F(w): for A = 2C and g1 > 0 that of -g1 is sqrt(w)/2, that of b/g3² is -2b/w, that of
# c (g1² - g2²) = c (Q - 1) is -c, with Q = 3s² at s; for C = 2A, mirrored, -g3 has 1/(2w), b/g1² has -2b w².
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
"""With 9, a window that opens and merges between two of the λ is missed, as docs/atlas.md says."""


# Between the singularities at the poles the others take ten times as long as the last one.
@pytest.mark.parametrize(
    "name", ["mirrored", *seldom("appears and merges", "four changes, one across the equator")]
)
def test_what_is_seen_is_what_is_proved_of_the_same_potential(name, monkeypatch):
    moments, text, F, G, ends = PAIRS[name]
    on, over = body(*moments), LambdaRange(*map(Fraction, ends))
    known = formula(text, on)
    # Windows of one λ for each part: of the integral it takes a minute to find these, next to the poles.
    monkeypatch.setattr(module, "find_windows", lambda on, _, motion: find_windows(on, known, motion))
    proved = make_atlas(on, known, over, SAMPLES)
    sampled = make_atlas(on, general_potential(on, F, G, {}), over, SAMPLES)
    assert (proved.proof, sampled.proof) == ("proved", "seen")
    assert not proved.undecided
    assert not sampled.undecided
    assert proved.changes
    assert [change.kind for change in sampled.changes] == [change.kind for change in proved.changes]
    for one, other in zip(sampled.changes, proved.changes, strict=True):
        assert one.lower.union(one.upper).overlaps(other.lower.union(other.upper))
        # WIDEST is 16e-10 in log λ of the primed axes, twice as much at most in the client's.
        assert one.upper - one.lower < 4e-9 * one.upper
    for part, same in zip(sampled.parts, proved.parts, strict=True):
        told, expected = (
            [(band.window.kind, band.window.ends, len(band.window.arcs)) for band in each.series.bands]
            for each in (part, same)
        )
        assert told == expected
        are_single_motions(on, known, part.series, (1, -2))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("F", ["w^2", "w/(1+w)"])
def test_windows_are_those_of_single_motions_of_the_integral(F):
    on, over = body(3, 2), LambdaRange(Fraction(1, 5), Fraction(2))
    potential = general_potential(on, F, "g2^2-1/3", {})
    sampled = make_atlas(on, potential, over, SAMPLES)
    assert [change.kind for change in sampled.changes] == ["window_vanishes"]
    for part, count in zip(sampled.parts, (1, 0), strict=True):
        assert len(part.series.bands) == count
        are_single_motions(on, potential, part.series, (2,))
        # Between the samples too, at a λ that no sample is.
        between = 0.7 * float(part.lower) + 0.3 * float(part.upper)
        assert len(find_windows(on, potential, PlanarMotion(Fraction(between)))) == count


def test_what_is_late_is_undecided():
    on = body(3, 2)
    late = make_atlas(
        on,
        general_potential(on, "w^2", "g2^2-1/3", {}),
        LambdaRange(Fraction(1, 5), Fraction(2)),
        SAMPLES,
        lambda: True,
    )
    assert (late.parts, late.changes) == ((), ())
    # Every λ is in one of the stretches: they touch, at values that are rounded to doubles.
    assert sum(float(high - low) for low, high in late.undecided) == pytest.approx(1.8, abs=1e-12)


def are_single_motions(on, potential, series, rows):
    """Ends and energies at some λ are those of single motions there."""
    for row in rows:
        motion = PlanarMotion(Fraction(float(series.lambda_[row])))
        found = find_windows(on, potential, motion)
        for band, window in zip(series.bands, found, strict=True):
            for told, ends in ((band.g1, window.g1), (band.g2, window.g2)):
                for end, own in zip(told, ends, strict=True):
                    # Windows are told in doubles: half a unit in the last place of numbers up to 1.
                    assert abs(end.value[row] - own) <= end.error[row] + 2.0**-53
        with ctx.workprec(160):
            h = make_loop(on, potential, motion).energy(arb("0.7"))
        assert abs(arb(series.energy.value[row]) - h) <= arb(series.energy.error[row])
