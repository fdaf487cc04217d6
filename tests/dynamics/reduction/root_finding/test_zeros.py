"""Zeros between places of known sign, on functions whose zeros are known."""

import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.root_finding.zeros import (
    LoopPlace,
    Region,
    classify_pole,
    enclose_zero,
    zeros_between,
)


@pytest.fixture(autouse=True)
def bits():
    with ctx.workprec(160):
        yield


def places(*points: tuple[Region, str]) -> list[LoopPlace]:
    return [LoopPlace(region, arb(x)) for region, x in points]


@pytest.mark.parametrize(
    ("function", "a", "b", "root"),
    [
        (lambda x: x * x - 2, "1", "2", "2"),
        # Flat on one side of the root and steep on the other: the weights have to work.
        (lambda x: x**9 - arb(2) ** -40, "0", "100", None),
        (lambda x: x.exp() - 1000, "-50", "60", None),
    ],
)
def test_the_enclosure_holds_the_root_tightly(function, a, b, root):
    found = enclose_zero(function, arb(a), arb(b))
    assert function(found).contains(arb(0))
    assert found.rel_accuracy_bits() > 130
    if root is not None:
        assert (found * found).contains(arb(root))


def test_a_zero_between_two_regions_is_found():
    cuts = places(("north", "0.6"), ("middle", "0.9"), ("middle", "2.2"), ("south", "0.7"))

    def radicand(place: LoopPlace) -> arb:
        v = place.v()
        return (v - arb("0.75")) * (arb("2.4") - v)

    zeros, signs = zeros_between(cuts, radicand)
    assert signs == [-1, 1, -1]
    assert [zero.kind for zero in zeros] == ["simple", "simple"]
    assert [float(zero.v) for zero in zeros] == [0.75, 2.4]


@pytest.mark.parametrize(
    ("power", "kind", "signs"),
    [(1, "simple", [-1, 1]), (2, "multiple", [1, 1]), (3, "multiple", [-1, 1])],
)
def test_a_cut_that_is_a_zero_is_told_by_its_neighbours(power, kind, signs):
    cuts = places(("middle", "1"), ("middle", "1.5"), ("middle", "2"))
    zeros, found = zeros_between(cuts, lambda place: (place.x - arb(3) / 2) ** power)
    assert found == signs
    assert [(float(zero.v), zero.kind) for zero in zeros] == [(1.5, kind)]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_positive_stretch_ends_where_there_is_no_value(sign):
    cuts = places(("middle", "1"), ("middle", "1.5"), ("middle", "2"))

    def radicand(place: LoopPlace) -> arb:
        return arb("nan") if sign * (place.x - arb("1.8")) > 0 else place.x

    zeros, signs = zeros_between(cuts, radicand)
    assert signs == [sign, -sign]
    # Found by halving the gap between 1.5 and 2 as long as there are bits.
    assert [(zero.kind, abs(float(zero.v) - 1.8) < 1e-15) for zero in zeros] == [("edge", True)]


def test_without_any_value_there_is_no_positive_stretch():
    cuts = places(("middle", "1"), ("middle", "1.5"), ("middle", "2"))
    assert zeros_between(cuts, lambda _: arb("nan")) == ([], [-1])
    # Next to a negative stretch the edge of the domain ends nothing.
    assert zeros_between(cuts, lambda place: arb("nan") if place.x > 1.8 else -place.x) == ([], [-1])


@pytest.mark.parametrize(
    ("function", "kind"),
    [
        (lambda x: 3 + x, "passable"),
        (lambda x: x - 3, "blocked"),
        (lambda x: 1 / x, "collision"),
        (lambda x: -x.log(), "collision"),
        (lambda x: x * x, "asymptotic"),
        (lambda _: arb("nan"), "blocked"),
    ],
)
def test_what_happens_at_a_pole_is_read_off_the_power_law(function, kind):
    assert classify_pole(lambda place: function(place.x), "north") == kind


def test_a_planar_motion_has_one_constant():
    for lambda_, nu in ((None, None), (1, 1)):
        with pytest.raises(ValueError, match="exactly one"):
            PlanarMotion(lambda_, nu)
