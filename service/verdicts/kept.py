"""Finds verdicts and windows, unless they are kept from an earlier examination, and notes what it finds."""

import time
from collections.abc import Callable, Iterable, Mapping
from itertools import islice

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import find_windows, find_windows_together, remember_windows
from service.dynamics.verdict.simple_form import simplified
from service.dynamics.verdict.verdict import Verdict, decide
from service.verdicts.kept_verdicts import read_verdict, write_verdict
from service.verdicts.kept_windows import read_windows, write_windows
from service.verdicts.searches import deadline

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


class Kept:
    """Contents that are kept, by their keys, and those that were found besides."""

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
            kept = read_windows(content, body, potential, motion)
            # For whatever else in this process asks for them.
            remember_windows(body, kept[0].arcs[0].loop.potential if kept else potential, motion, kept)
            return kept
        potential = simplified(potential)
        if key in self._curves and key not in self._together:
            self._look_ahead(key, body, potential)
        known = None if key is None else self._together.get(key)
        if isinstance(known, DynamicsError):
            raise known.with_traceback(None)
        windows = find_windows(body, potential, motion) if known is None else known
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
