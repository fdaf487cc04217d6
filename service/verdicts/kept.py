"""Finds verdicts and windows, unless they are kept from an earlier examination, and notes what it finds."""

from collections.abc import Callable, Mapping

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import find_windows, remember_windows
from service.dynamics.verdict.verdict import Verdict, decide
from service.verdicts.kept_verdicts import read_verdict, write_verdict
from service.verdicts.kept_windows import read_windows, write_windows
from service.verdicts.searches import deadline

VERDICT_PROCESSOR_SECONDS, VERDICT_SECONDS = 4.0, 7.0
"""After either limit an open verdict stays undecided; what follows it takes time too."""

Keys = tuple[str | None, str | None]
"""Of the verdict and of the windows; None where nothing is kept."""


def verdict_deadline() -> Callable[[], bool]:
    """Return a function that tells whether the time of one verdict is over."""
    return deadline(VERDICT_PROCESSOR_SECONDS, VERDICT_SECONDS)


class Kept:
    """Contents that are kept, by their keys, and those that were found besides."""

    def __init__(self, contents: Mapping[str, str]) -> None:
        self._contents = contents
        self._verdicts: dict[str, Verdict] = {}
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
        """Return all windows on the curve of a motion; raises what :func:`find_windows` raises."""
        content = None if key is None else self._contents.get(key)
        if content is not None:
            # For whatever else in this process asks for them.
            remember_windows(body, potential, motion, read_windows(content, body, potential, motion))
        windows = find_windows(body, potential, motion)
        if key is not None and content is None:
            written = write_windows(windows)
            if written is not None:
                self.found[key] = written
        return windows
