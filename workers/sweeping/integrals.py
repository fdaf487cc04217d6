"""Measures the integrals that a sweep keeps along each motion, by the functions of a single job."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.further_integrals import FurtherIntegral, find_further_integrals, integral_drift
from service.dynamics.potentials.potential import Potential
from workers.solvers.invariants import drifts_of

FloatArray = NDArray[np.float64]

DRIFTS = ("energy", "geometric", "areas")
"""Integrals that every motion has."""
_DRIFTS = {f"invariants.{name}.drift" for name in DRIFTS}


def keeps_further(keep: Sequence[str]) -> bool:
    """Tell whether further integrals are among the kept numbers; they depend on B."""
    return any(name.startswith("invariants.") and name not in _DRIFTS for name in keep)


class KeptIntegrals:
    """What is kept of the integrals of one sweep."""

    def __init__(self, body: RigidBody, keep: Sequence[str]) -> None:
        self._body = body
        self._keeps_drifts = not _DRIFTS.isdisjoint(keep)
        self._keeps_further = keeps_further(keep)
        self.names = tuple(name for name in keep if name.startswith("invariants."))
        self._known: tuple[Potential, int] | None = None
        self._further: tuple[FurtherIntegral, ...] = ()

    def along(
        self, potential: Potential, sign_of_g1: Literal[1, -1], energy: float, samples: FloatArray
    ) -> dict[str, float]:
        """Return the numbers of a planar motion with these ``samples``, shape (n, 6), by their names."""
        found: dict[str, float] = {}
        if self._keeps_drifts:
            drifts = drifts_of(self._body, potential, samples, energy, is_planar=True)
            found = {f"invariants.{name}.drift": getattr(drifts, name) for name in DRIFTS}
        if self._keeps_further:
            for integral in self._further_of(potential, sign_of_g1):
                name = f"invariants.{integral.name}"
                found[name], found[f"{name}.drift"] = integral_drift(integral, samples)
        return found

    def _further_of(self, potential: Potential, sign: Literal[1, -1]) -> tuple[FurtherIntegral, ...]:
        known = self._known
        if known is None or known[0] is not potential or known[1] != sign:
            self._known = potential, sign
            self._further = find_further_integrals(self._body, potential, g1_sign=sign)
        return self._further
