"""Writes the windows of a curve as JSON, and reads the same windows again, to the last bit of every ball."""

import json
from typing import Any  # what was read from JSON

from service.dynamics.body import RigidBody
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint, loop_at
from service.dynamics.reduction.root_finding.gap import NearRest
from service.dynamics.reduction.window import Arc, Window
from service.dynamics.verdict.simple_form import is_simplified, with_simpler
from service.verdicts.exact_balls import NotExactError, read_ball, write_ball

Document = dict[str, object]

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
    if found["formula"] is not None and isinstance(potential, FormulaPotential):
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
