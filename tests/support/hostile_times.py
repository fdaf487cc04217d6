"""Times along a motion with known features, in balls: integrals by flint, cut at the features.

Between two places dt = Z dv/(c p). At a rest v₀ the substitution v = v₀ ± u² and
p² = (v − v₀) K, K a difference quotient or, on boxes that nearly touch v₀, an
enclosure of the derivative on their hull, leave nothing singular; at a pole
that is passed it is v = u^m. Where p² is like (v − v₀)^-k the substitution of a rest leaves u^(k+1) times
what is analytic. Every place comes with its time and its state.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flint import acb, arb

from tests.support.hostile_curve import Curve
from tests.support.hostile_features import INSIDE, Feature
from tests.support.hostile_reference import Cuts, Stretch, UnknownError, sides_at
from tests.support.jets import Jet, cos, power, root

GOAL = arb(2) ** -88
"""Relative radius of the times that is asked for."""
MOST_EVALUATIONS = 30_000
UNSEEN = arb("1e-30")
"""Relative error of the time beside a flat hole, where the feature is below 1e-43 of its height."""

Integrand = Callable[[acb], acb]


@dataclass(frozen=True, slots=True)
class Timeline:
    """Times from the lower end of a stretch on, or from one of its places if the motion never was there."""

    places: tuple[arb, ...]
    times: tuple[arb, ...]
    end: arb | None
    """The time of the upper end, if it is reached."""
    begins: bool
    """The lower end is where the times count from."""
    collisions: tuple[arb | None, arb | None]
    """The times of the ends at which p² is infinite."""


def timeline(
    curve: Curve, features: Sequence[Feature], cuts: Cuts, stretch: Stretch, places: Sequence[arb]
) -> Timeline:
    """Return the times of some places inside a stretch, given in the order of v."""
    inner = [v for v in (*cuts.places, *cuts.kinks) if v > stretch.lower and v < stretch.upper]
    inner += [v for hole in cuts.holes for v in hole if v > stretch.lower and v < stretch.upper]
    inner += [(stretch.lower + stretch.upper) / 2]
    points = sorted([*places, *(arb(v.mid()) for v in inner)], key=_Place)
    time, times = arb(0), {}
    legs = _Legs(curve, features, cuts, stretch)
    time = legs.from_end(points[0]) if stretch.lower_end in ("rest", "passed") else arb(0)
    for k, v in enumerate(points):
        if k:
            time = time + legs.between(points[k - 1], v)
        times[id(v)] = time
    end = time + legs.to_end(points[-1]) if stretch.upper_end in ("rest", "passed") else None
    begins = stretch.lower_end in ("rest", "passed")
    first = -legs.from_end(points[0]) if stretch.lower_end == "infinite" else None
    last = time + legs.to_end(points[-1]) if stretch.upper_end == "infinite" else None
    return Timeline(tuple(places), tuple(times[id(v)] for v in places), end, begins, (first, last))


def half_round(line: Timeline) -> arb | None:
    """Return the time from end to end, None if one of them is not reached."""
    return line.end if line.begins else None


class _Place:
    """A place that can be sorted: doubles do not tell those apart that are nearer than a feature is wide."""

    def __init__(self, v: arb) -> None:
        self.v = v

    def __lt__(self, other: "_Place") -> bool:
        return bool(arb(self.v.mid()) < arb(other.v.mid()))


class _Legs:
    def __init__(self, curve: Curve, features: Sequence[Feature], cuts: Cuts, stretch: Stretch) -> None:
        self.curve, self.features, self.cuts, self.stretch = curve, features, cuts, stretch

    def between(self, a: arb, b: arb) -> arb:
        if not a < b:
            return (b - a) * 0
        sides, hole = self._where(a, b)
        return self._integral(lambda v: self._rate(v, sides), a, b, hole)

    def from_end(self, to: arb) -> arb:
        return self._at_end(self.stretch.lower, to, self.stretch.lower_end, 1)

    def to_end(self, since: arb) -> arb:
        return self._at_end(self.stretch.upper, since, self.stretch.upper_end, -1)

    def _at_end(self, end: arb, inside: arb, kind: str, sign: int) -> arb:
        sides, hole = self._where(end.min(inside), end.max(inside))
        if kind == "rest":
            return self._integral(
                lambda u: self._rate_at_rest(end, u, sign, sides),
                arb(0),
                (sign * (inside - end)).sqrt(),
                hole,
            )
        if kind == "infinite":
            return self._integral(
                lambda u: self._rate_at_infinity(end, u, sign, sides),
                arb(0),
                (sign * (inside - end)).sqrt(),
                hole,
            )
        m = self.curve.m
        reach = inside if sign > 0 else arb.pi() - inside
        reach = reach if m == 1 else reach.root(m)
        return self._integral(lambda u: self._rate_at_pole(u, sign, sides), arb(0), reach, hole)

    def _where(self, a: arb, b: arb) -> tuple[tuple[int, ...], bool]:
        middle = (a + b) / 2
        sides = sides_at(self.curve, self.features, arb(middle.mid()))
        inside = any(middle > low and middle < high for low, high in self.cuts.holes)
        if inside:
            # Other holes are not there; what else is kinked has its side.
            pairs = zip(self.features, sides, strict=True)
            sides = tuple(INSIDE if feature.shape == "hole" else side for feature, side in pairs)
        return sides, inside

    def _rate(self, v: acb, sides: tuple[int, ...]) -> acb:
        tau = self.curve.tau(v)
        c = self.curve.c_of(tau)
        return self.curve.Z / (c * root(self.curve.p_squared(tau, c * v.cos(), sides), 2))

    def _rate_at_rest(self, end: arb, u: acb, sign: int, sides: tuple[int, ...]) -> acb:
        away = u * u
        v = end + sign * away
        tau = self.curve.tau(v)
        c = self.curve.c_of(tau)
        size = away.abs_lower()
        if size > 4 * acb(away).rad() and size > 0:
            quotient = self.curve.p_squared(tau, c * v.cos(), sides) / away
        else:
            jet = Jet(v.union(acb(end)), acb(1))
            tau_jet = self.curve.tau(jet)
            quotient = self.curve.p_squared(tau_jet, self.curve.c_of(tau_jet) * cos(jet), sides).slope * sign
        return 2 * self.curve.Z / (c * root(quotient, 2))

    def _rate_at_infinity(self, end: arb, u: acb, sign: int, sides: tuple[int, ...]) -> acb:
        """Return 2 u Z √w/(c √(w p²)) with the weight w = (u² q)^k w', q = |t|/u² at the end."""
        away = u * u
        v = end + sign * away
        tau = self.curve.tau(v)
        c = self.curve.c_of(tau)
        y = c * v.cos()
        pairs = [(f, side) for f, side in zip(self.features, sides, strict=True) if f.shape == "infinite"]
        own = min(pairs, key=lambda pair: float(abs(pair[0].distance(self.curve.g2(end), pair[1]).mid())))
        size = away.abs_lower()
        if size > 4 * acb(away).rad() and size > 0:
            quotient = own[0].distance(y, own[1]) / away
        else:
            jet = Jet(v.union(acb(end)), acb(1))
            tau_jet = self.curve.tau(jet)
            quotient = own[0].distance(self.curve.c_of(tau_jet) * cos(jet), own[1]).slope * sign
        k = own[0].power
        others = acb(1)
        for feature, side in pairs:
            if feature is not own[0]:
                others = others * power(feature.distance(y, side), feature.power)
        weight = root(power(quotient, k) * others, 2)
        p = root(self.curve.weighted_p_squared(tau, y, sides), 2)
        return 2 * power(u, k + 1) * self.curve.Z * weight / (c * p)

    def _rate_at_pole(self, u: acb, sign: int, sides: tuple[int, ...]) -> acb:
        m = self.curve.m
        from_pole = power(u, m)
        tau = u * root(from_pole.sinc(), m)
        c = self.curve.c_of(tau)
        y = c * from_pole.cos() * sign
        return m * power(u, m - 1) * self.curve.Z / (c * root(self.curve.p_squared(tau, y, sides), 2))

    @staticmethod
    def _integral(f: Integrand, a: arb, b: arb, hole: bool) -> arb:
        value = acb.integral(
            lambda x, _: f(x), acb(a), acb(b), rel_tol=GOAL, abs_tol=GOAL, eval_limit=MOST_EVALUATIONS
        ).real
        if not value.is_finite():
            raise UnknownError("an integral has no enclosure")
        return value * (1 + arb(0, UNSEEN)) if hole else value
