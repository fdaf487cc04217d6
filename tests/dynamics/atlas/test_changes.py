"""Values of λ where windows change: against closed forms, and against a scan of values."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.atlas.atlas import make_atlas
from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.body import EqualMomentsError
from service.schemas.atlas.documents import read_atlas
from tests.support.effort import examples, one_in
from tests.support.planar import body, formula

DOUBLE, MIRRORED = body(2, 1), body(1, 2)


def drawn(rigid_body, text, lower, upper, **signs):
    potential = formula(text, rigid_body) if isinstance(text, str) else text
    return make_atlas(rigid_body, potential, LambdaRange(Fraction(lower), Fraction(upper), **signs), 12)


def kinds(atlas):
    return [change.kind for change in atlas.changes]


def encloses(change, value):
    # The true value is a ball; an enclosure is at most some 1e-9 of λ wide, as NARROW says.
    is_narrow = change.upper - change.lower < 1e-8 * change.upper
    return change.lower < value and value < change.upper and is_narrow


def test_a_window_appears_at_the_equator():
    """V = -g1 + b/g3², A = 2C: D = g3 - 2b g1/g3³ is 0 at the equator where 2b/λ² + 4b²/λ⁸ = 1."""
    atlas = drawn(DOUBLE, "-g1 + 1/(20*g3^2)", "1/10", 2)
    assert kinds(atlas) == ["window_appears"]
    assert not atlas.undecided
    with ctx.workprec(128):
        low, high = arb("0.5"), arb(1)
        for _ in range(100):
            middle = (low + high) / 2
            value = 1 / (10 * middle**2) + 1 / (100 * middle**8) - 1
            low, high = (middle, high) if value > 0 else (low, middle)
        assert encloses(atlas.changes[0], low.union(high))
    assert abs(float(atlas.changes[0].g2.value)) <= float(atlas.changes[0].g2.error)


def test_windows_merge_on_the_equator():
    """V = -g1 + c(g1² - g2²): D = g3 (1 - 2c g1) is 0 on the equator where g1 = 1/4, so λ² g1 = 1 - g1²."""
    atlas = drawn(DOUBLE, "-g1 + 2*(g1^2 - g2^2)", "1/10", 10)
    assert kinds(atlas) == ["windows_merge"]
    with ctx.workprec(128):
        assert encloses(atlas.changes[0], (arb(15) / 4).sqrt())
    # With the other sign the same places bound the motions from the other side.
    turned = drawn(DOUBLE, "g1 - 2*(g1^2 - g2^2)", "1/10", 10)
    assert kinds(turned) == ["window_vanishes"]
    with ctx.workprec(128):
        assert encloses(turned.changes[0], (arb(15) / 4).sqrt())


def test_a_mirrored_body_has_the_same_atlas():
    """(A, C; g1, g3) → (C, A; g3, g1) leads a curve λ to the curve λ^(-A/C), hence growing λ to falling λ."""
    one = drawn(DOUBLE, "-g1 + 1/(20*g3^2) + 3/2*(g1^2 - g2^2)", "1/2", 4)
    other = drawn(MIRRORED, "-g3 + 1/(20*g1^2) + 3/2*(g3^2 - g2^2)", "1/16", 4)
    turned = {"window_appears": "window_vanishes", "windows_merge": "window_splits"}
    assert kinds(one) == ["window_appears", "windows_merge"]
    assert kinds(other) == [turned[kind] for kind in reversed(kinds(one))]
    for change, image in zip(one.changes, reversed(other.changes), strict=True):
        # λ' = λ^-2 for A = 2C, whose mirror has A/C = 1/2, so that λ = λ'^(-1/2).
        assert (change.lower**-2).overlaps(image.upper.union(image.lower))


def test_changes_away_from_the_equator():
    atlas = drawn(DOUBLE, "-g1 + 1/(20*g3^2) + (2*g1^2+g3^2)*(g2 + 2*g2^2)", "1/10", 10)
    expected = ["window_appears", "end_crosses_equator", "window_appears", "windows_merge"]
    assert kinds(atlas) == expected
    assert not atlas.undecided
    # On the equator the term in g2 is 0 and so is its part in D: the change there is that of the first test.
    alone = drawn(DOUBLE, "-g1 + 1/(20*g3^2)", "1/10", 2)
    assert (
        atlas.changes[1]
        .lower.union(atlas.changes[1].upper)
        .overlaps(alone.changes[0].lower.union(alone.changes[0].upper))
    )


SCANNED = [
    (2, 1, "-g1"),
    (2, 1, "-g1 + 1/(20*g3^2)"),
    (2, 1, "-g1 + 1/(20*g3^2) + 3/2*(g1^2-g2^2)"),
    (2, 1, "-g1 + 2*(g1^2-g2^2)"),
    (2, 1, "g1 - 2*(g1^2-g2^2)"),
    (2, 1, "-g1 + 1/(20*g3^2) + (2*g1^2+g3^2)*(g2+2*g2^2)"),
    (2, 1, "-g1 + (2*g1^2+g3^2)*2*exp(-100*(g2-3/10)^2)"),
    (2, 1, "-g1 - (2*g1^2+g3^2)*exp(-100*(g2-3/10)^2)"),
    (2, 1, "-g1 + 2*(2*g1^2+g3^2)*abs(g2-1/3)"),
    (2, 1, "-g1 + (2*g1^2+g3^2)*sin(8*g2)"),
    (2, 1, "-g1 + (2*g1^2+g3^2)*g2^3"),
    (2, 1, "-g1 - 1/(50*g3^2) + (2*g1^2+g3^2)*g2^2"),
    (1, 2, "-g3"),
    (1, 2, "-g3 + 1/(20*g1^2) + 3/2*(g3^2-g2^2)"),
    (3, 2, "(3*g1^2+2*g3^2)*(g2^2-g2/2+1/20)"),
    (3, 2, "(3*g1^2+2*g3^2)*cos(5*g2)"),
    (5, 4, "(5*g1^2+4*g3^2)*exp(g2)"),
    (2, 1, "(2*g1^2+g3^2)*(g2^4-g2^2/2)-g1/10"),
    (2, 1, "-g1 + (2*g1^2+g3^2)*abs(g2)/2"),
    (2, 1, "-g1/5 + (2*g1^2+g3^2)*tan(g2)"),
    # Zeros that stay on the equator, at a pole or elsewhere for every λ.
    (3, 2, "(3*g1^2+2*g3^2)*g2*(g2-2)"),
    (2, 3, "(2*g1^2+3*g3^2)*(g2-1)*(g2+1/2)"),
    (2, 1, "(2*g1^2+g3^2)*g2^3*(g2-1/3)*(g2+2/3)"),
    (2, 1, "(2*g1^2+g3^2)*(abs(g2)-1/3)*g2"),
    (3, 2, "(3*g1^2+2*g3^2)*(g2-1/2)^2"),
    (2, 1, {"type": "rational", "a": [], "b": [], "c": ["1/2", "-1/2"]}),
    # Families: the terms of the paper for A = 2C, and for bodies with other powers, also with A < C.
    (2, 1, {"type": "rational", "a": [-1, "1/2"], "b": ["1/2"], "c": [0, "1/50"]}),
    (3, 2, {"type": "homogeneous", "A": [-1], "B": ["1/2"]}),
    (5, 3, {"type": "homogeneous", "B": [-1, "1/2"], "C": ["1/20"]}),
    (1, 3, {"type": "homogeneous", "A": ["-1/3"], "B": ["1/4"], "C": [-1]}),
    (3, 4, {"type": "homogeneous", "B": [-1, "1/3"], "C": [0, "1/10"]}),
]
PLACES = 1500
"""On a quarter of the curve: zeros that are closer than 1/1500 of it are not told apart by the scan."""


SCAN = 100_000
"""λ of one potential in the long run."""
AT_ONCE = 40
"""λ whose places are evaluated together: some megabytes."""


def windows_at(A, C, potential, lambdas):
    """Return for each λ how often D changes its sign along the half curve, by values only."""
    alpha, lambdas = A / C, np.asarray(lambdas)
    # |g1| is x^max(α, 1) and |g3| = λ|g1|^(1/α): the equator is where their squares add up to 1.
    low, high = np.zeros(len(lambdas)), np.ones(len(lambdas))
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_inside = middle**2 + (lambdas * middle ** (1 / alpha)) ** 2 < 1.0
        low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
    angles = (np.arange(PLACES) + 0.5) / PLACES * (np.pi / 2)
    along, counts = np.sin(angles) ** max(alpha, 1.0), []
    for start in range(0, len(lambdas), AT_ONCE):
        here = slice(start, start + AT_ONCE)
        g1 = low[here, None] * along
        g3 = lambdas[here, None] * g1 ** (1 / alpha)
        g2 = np.sqrt(np.maximum(1.0 - g1 * g1 - g3 * g3, 0.0))
        whole = [np.concatenate([each, each[:, ::-1]], axis=1) for each in (g1, g3)]
        D = potential.D_real(whole[0], np.concatenate([g2, -g2[:, ::-1]], axis=1), whole[1])
        signs = np.sign(np.broadcast_to(D, whole[0].shape))
        counts += np.count_nonzero(np.diff(signs, axis=1) != 0, axis=1).tolist()
    return counts


@pytest.mark.random_law
@pytest.mark.parametrize(("A", "C", "given"), one_in(8, SCANNED), ids=str)
def test_no_change_is_missed_or_invented(A, C, given):
    """The number of zeros that the scan sees is that of the atlas at every λ, but next to the changes.

    Two zeros that meet at a change are as far apart as the root of the distance in λ: at 5e-4 of λ from it,
    more than the steps of the scan, for curves on which p² bends as here.
    """
    document = {"type": "expression", "expression": given} if isinstance(given, str) else given
    asked = read_atlas({"body": {"A": A, "C": C}, "potential": document, "lambda": ["1/5", 5]})
    potential = asked.potential
    atlas = drawn(asked.body, potential, "1/5", 5)
    assert not atlas.undecided
    for part in atlas.parts:
        low, high = float(part.lower), float(part.upper)
        inner = np.geomspace(low, high, examples(12, SCAN // len(atlas.parts)) + 2)[1:-1]
        away = inner[(inner > low * 1.0005) & (inner < high / 1.0005)]
        counts = set(windows_at(A, C, potential, away))
        assert len(counts) <= 1, (low, high, counts)
    for change in atlas.changes:
        value = float(change.lower)
        before, after = windows_at(A, C, potential, [value / 1.002, value * 1.002])
        assert before != after or change.kind == "end_crosses_equator", (value, change.kind)


def test_what_is_not_proved_is_undecided():
    late = make_atlas(
        DOUBLE,
        formula("-g1 + 1/(20*g3^2)", DOUBLE),
        LambdaRange(Fraction(1, 10), Fraction(2)),
        12,
        lambda: True,
    )
    assert late.changes == ()
    assert any(low < arb("0.58696") and high > arb("0.58697") for low, high in late.undecided)


def test_a_wall_narrower_than_the_proofs_reach_is_not_passed_over():
    atlas = drawn(DOUBLE, "-g1+(2*g1^2+g3^2)*2*exp(-10^6*(g2-3/10)^2)", "3/2", 3)
    told = sum(float(part.upper - part.lower) for part in atlas.parts)
    open_ = sum(float(high - low) for low, high in atlas.undecided)
    # Every λ is in a part, in a change or undecided; the wall lets motions pass above 1.876 only.
    assert told + open_ == pytest.approx(1.5, abs=1e-6)
    for part in atlas.parts:
        if part.upper < 1.87:
            assert len(part.series.bands) == 2


def test_refusals():
    with pytest.raises(EqualMomentsError):
        drawn(body(1, 1), "g1", 1, 2)
