"""Verdicts and windows: found unless they are cached, written as JSON, and read again to the last bit.

Balls are written as text without any loss: midpoint and radius as integers times powers of 2. Decimals would
round. Hexadecimal integers have no limit of length, unlike decimal ones in Python.
"""

import json
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from fractions import Fraction
from itertools import islice
from typing import Any  # what was read from JSON

from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import format_tree
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint, loop_at
from service.dynamics.reduction.root_finding.gap import NearRest
from service.dynamics.reduction.window import Arc, Window
from service.dynamics.reduction.windows import find_windows, find_windows_together, remember_windows
from service.dynamics.verdict.refutations import Counterexample, DecimalBall, Jump
from service.dynamics.verdict.simple_form import is_simplified, simplified, with_simpler
from service.dynamics.verdict.verdict import NumericEvidence, Verdict, decide
from service.schemas.reading.documents import Document
from service.verdicts.refusals import deadline

Written = list[object]

RADIUS_BITS = 30
"""Bits of the radius of a ball in flint."""


class NotExactError(ValueError):
    """The ball has no ends, or does not come back as it was."""


def write_ball(ball: arb) -> Written:
    """Return [mantissa, exponent] of the midpoint, and of the radius unless it is 0."""
    if not ball.is_finite():
        raise NotExactError("a ball is not finite")
    (mid, exponent), (rad, scale) = ball.mid().man_exp(), ball.rad().man_exp()
    written: Written = [hex(int(mid)), int(exponent)]
    if rad != 0:
        written += [hex(int(rad)), int(scale)]
    back = read_ball(written)
    if (back.mid().man_exp(), back.rad().man_exp()) != ((mid, exponent), (rad, scale)):
        raise NotExactError("a ball does not come back to the last bit")
    return written


def read_ball(written: list[Any]) -> arb:
    """Return the very ball that :func:`write_ball` wrote, at any precision."""
    mid = int(written[0], 16), int(written[1])
    if len(written) == 2:
        return arb(mid)
    rad, scale = int(written[2], 16), int(written[3])
    shift = RADIUS_BITS - rad.bit_length()
    # flint takes a radius that it is given down to its 30 leading bits and adds a unit of the last of them:
    # half a unit less than the radius becomes the radius.
    return arb(mid, ((rad << shift + 1) - 1, scale - shift - 1))


_POINT = ("g1", "g2", "g3", "c", "P")


def write_windows(windows: tuple[Window, ...]) -> str | None:
    """Return the windows as JSON text; None if a ball in them has no exact form."""
    if not windows:
        return json.dumps({"loop": None, "windows": []})
    loop = windows[0].arcs[0].loop
    try:
        written = {
            "formula": format_tree(loop.potential.tree) if is_simplified(loop.potential) else None,
            "loop": [write_ball(loop.Z), write_ball(loop.G)],
            "windows": [_window(window) for window in windows],
        }
    except NotExactError:
        return None
    return json.dumps(written, separators=(",", ":"), allow_nan=False)


def read_windows(
    text: str, body: RigidBody, potential: Potential, motion: PlanarMotion
) -> tuple[Window, ...]:
    """Return the windows that :func:`write_windows` wrote, for the problem that they were found for.

    Their loops have the potential they were found with, which may be a simpler one that was proved equal.
    """
    found = json.loads(text)
    if not found["windows"]:
        return ()
    if found["formula"] is not None:
        potential = with_simpler(potential.as_stated, parse(found["formula"]))
    Z, G = map(read_ball, found["loop"])
    loop = loop_at(body, potential, motion, Z, G)
    return tuple(_read_window(window, loop) for window in found["windows"])


def _window(window: Window) -> Document:
    return {
        "index": window.index,
        "kind": window.kind,
        "ends": window.ends,
        "g1": window.g1,
        "g2": window.g2,
        "arcs": [_arc(arc) for arc in window.arcs],
    }


def _arc(arc: Arc) -> Document:
    return {
        "lower": write_ball(arc.lower),
        # An arc that is a point has one end, of which both are names.
        "upper": None if arc.upper is arc.lower else write_ball(arc.upper),
        "ends": [arc.lower_end, arc.upper_end],
        "slow": [_near(near) for near in arc.slow],
    }


def _near(near: NearRest) -> list[object]:
    return [
        write_ball(near.v),
        write_ball(near.square),
        write_ball(near.K),
        [write_ball(getattr(near.at, name)) for name in _POINT],
    ]


def _read_window(written: dict[str, Any], loop: Loop) -> Window:
    (lo_end, hi_end), (lo, hi), (south, north) = written["ends"], written["g1"], written["g2"]
    arcs = tuple(_read_arc(arc, loop) for arc in written["arcs"])
    return Window(written["index"], written["kind"], (lo_end, hi_end), (lo, hi), (south, north), arcs)


def _read_arc(written: dict[str, Any], loop: Loop) -> Arc:
    lower = read_ball(written["lower"])
    upper = lower if written["upper"] is None else read_ball(written["upper"])
    slow = tuple(_read_near(near) for near in written["slow"])
    lower_end, upper_end = written["ends"]
    return Arc(loop, lower, upper, lower_end, upper_end, slow)


def _read_near(written: list[Any]) -> NearRest:
    v, square, K = map(read_ball, written[:3])
    return NearRest(v, square, K, LoopPoint(*map(read_ball, written[3])))


def write_verdict(verdict: Verdict) -> str:
    """Return the verdict as JSON text."""
    point, formulas = verdict.counterexample, verdict.energy_formulas
    written = {
        "verdict": verdict.verdict,
        "proof": verdict.proof,
        "energy_formula": verdict.energy_formula,
        # As pairs: the order of the quadrants is part of it.
        "energy_formulas": None if formulas is None else list(formulas.items()),
        "counterexample": None
        if point is None
        else {"g": [str(g) for g in point.g], "residual": asdict(point.residual)},
        "jump": None if verdict.jump is None else asdict(verdict.jump),
        "evidence": None if verdict.evidence is None else asdict(verdict.evidence),
    }
    return json.dumps(written, separators=(",", ":"), allow_nan=False)


def read_verdict(text: str) -> Verdict:
    """Return the verdict that :func:`write_verdict` wrote."""
    found = json.loads(text)
    formulas, evidence = found["energy_formulas"], found["evidence"]
    return Verdict(
        found["verdict"],
        found["proof"],
        energy_formula=found["energy_formula"],
        energy_formulas=None if formulas is None else dict(formulas),
        counterexample=_counterexample(found["counterexample"]),
        jump=_jump(found["jump"]),
        evidence=None if evidence is None else NumericEvidence(**evidence),
    )


def _counterexample(written: dict[str, Any] | None) -> Counterexample | None:
    if written is None:
        return None
    g1, g2, g3 = map(Fraction, written["g"])
    return Counterexample((g1, g2, g3), DecimalBall(**written["residual"]))


def _jump(written: dict[str, Any] | None) -> Jump | None:
    if written is None:
        return None
    g1, g2, g3 = written["g"]
    return Jump(written["of"], (g1, g2, g3), written["radius"], DecimalBall(**written["jump"]))


VERDICT_PROCESSOR_SECONDS, VERDICT_SECONDS = 4.0, 7.0
"""After either limit an open verdict stays undecided; what follows it takes time too."""

Keys = tuple[str | None, str | None]
"""Keys of the verdict and of the windows; None where nothing is cached."""

Ahead = tuple[str, str, PlanarMotion]
"""The keys of a verdict and of windows that will be asked for, and the motion whose curve they are of."""
TOGETHER = 64
"""Curves whose windows are found at once: enough that arrays are long, few enough that they are small."""


def verdict_deadline() -> Callable[[], bool]:
    """Return a function that tells whether the time of one verdict is over."""
    return deadline(VERDICT_PROCESSOR_SECONDS, VERDICT_SECONDS)


class ResultCache:
    """Cached results by their keys, and those that were found besides."""

    def __init__(self, contents: Mapping[str, str], ahead: Iterable[Ahead] = ()) -> None:
        self._contents = contents
        self._verdicts: dict[str, Verdict] = {}
        self._curves: dict[str, PlanarMotion] = {}
        self._settings: dict[str, str] = {}
        self._waiting: dict[str, dict[str, None]] = {}
        for setting, key, motion in ahead:
            if key not in contents:
                self._curves[key], self._settings[key] = motion, setting
                self._waiting.setdefault(setting, {})[key] = None
        self._together: dict[str, tuple[Window, ...] | DynamicsError] = {}
        self._shares: dict[str, float] = {}
        self._left = 0.0
        self.found: dict[str, str] = {}

    def verdict(self, key: str | None, body: RigidBody, potential: Potential) -> Verdict:
        """Return the verdict on a potential; raises what :func:`decide` raises."""
        if key is None:
            return decide(body, potential, verdict_deadline())
        if key in self._verdicts:
            return self._verdicts[key]
        content = self._contents.get(key)
        if content is not None:
            verdict = read_verdict(content)
        else:
            is_late = verdict_deadline()
            verdict = decide(body, potential, is_late)
            # One that ran out of time may be decided on another day.
            if verdict.verdict != "undecided" or not is_late():
                self.found[key] = write_verdict(verdict)
        self._verdicts[key] = verdict
        return verdict

    def windows(
        self, key: str | None, body: RigidBody, potential: Potential, motion: PlanarMotion
    ) -> tuple[Window, ...]:
        """Return all windows on the curve of a motion; raises what :func:`find_windows` raises.

        They are found with a simpler formula, where there is one, and have it.
        """
        content = None if key is None else self._contents.get(key)
        if content is not None:
            cached = read_windows(content, body, potential, motion)
            # For whatever else in this process asks for them.
            remember_windows(body, cached[0].arcs[0].loop.potential if cached else potential, motion, cached)
            return cached
        potential = simplified(potential)
        if key in self._curves and key not in self._together:
            self._look_ahead(key, body, potential)
        found = None if key is None else self._together.get(key)
        if isinstance(found, DynamicsError):
            raise found.with_traceback(None)
        windows = find_windows(body, potential, motion) if found is None else found
        if key is not None:
            written = write_windows(windows)
            if written is not None:
                self.found[key] = written
        return windows

    def share(self, key: str | None, seconds: float) -> float:
        """Return how many of the ``seconds`` just spent are those of the windows ``key``.

        Those spent on windows of others that came along are counted with the others.
        """
        ahead, self._left = self._left, 0.0
        return seconds - ahead + (0.0 if key is None else self._shares.pop(key, 0.0))

    def _look_ahead(self, key: str, body: RigidBody, potential: Potential) -> None:
        """Find the windows ``key`` together with those of curves ahead in the same body and potential."""
        waiting = self._waiting[self._settings[key]]
        waiting.pop(key, None)
        keys = [key, *islice(waiting, TOGETHER - 1)]
        if len(keys) == 1:
            return
        for other in keys[1:]:
            del waiting[other]
        began = time.perf_counter()
        motions = [self._curves[each] for each in keys]
        self._together |= zip(keys, find_windows_together(body, potential, motions), strict=True)
        self._left = time.perf_counter() - began
        self._shares |= dict.fromkeys(keys, self._left / len(keys))
