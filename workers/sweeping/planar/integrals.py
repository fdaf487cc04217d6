"""Measures the integrals that a sweep keeps along each motion, with the numbers of a single job."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.further_integrals import FurtherIntegral, find_further_integrals, integral_drift
from service.dynamics.potentials.potential import Potential
from workers.solvers.compiled.integrals.of_many import drifts_of_many, further_drifts_of_many
from workers.solvers.evidence import drifts_of
from workers.sweeping.parameters.programs import Group

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Sign = Literal[1, -1]

DRIFTS = ("energy", "geometric", "areas")
"""Integrals that every motion has."""
_DRIFTS = {f"invariants.{name}.drift" for name in DRIFTS}


def keeps_further(keep: Sequence[str]) -> bool:
    """Tell whether further integrals are among the kept numbers; they depend on B."""
    return any(name.startswith("invariants.") and name not in _DRIFTS for name in keep)


class KeptIntegrals:
    """The numbers that one sweep keeps of the integrals."""

    def __init__(self, body: RigidBody, keep: Sequence[str]) -> None:
        self._body = body
        self.keeps_drifts = not _DRIFTS.isdisjoint(keep)
        self._keeps_further = keeps_further(keep)
        self.names = tuple(name for name in keep if name.startswith("invariants."))
        self._known: tuple[Potential, Sign] | None = None
        self._further: tuple[FurtherIntegral, ...] = ()

    def along(
        self,
        group: Group,
        sign_of_g1: Sign,
        energies: FloatArray,
        samples: FloatArray,
        wanted: IntArray,
        potential_at: Callable[[int], Potential],
    ) -> dict[str, FloatArray]:
        """Return the numbers of the ``wanted`` motions of a group by their names, NaN of the others.

        ``samples`` have the shape (motions, n, 6); ``potential_at`` returns the potential of a motion. Where
        twice the digits do not tell a number, the functions of a single job do.
        """
        found: dict[str, FloatArray] = {}
        if self.keeps_drifts:
            drifts = self._drifts(group, energies, samples, wanted, potential_at)
            found |= {f"invariants.{name}.drift": drifts[:, k] for k, name in enumerate(DRIFTS)}
        if self._keeps_further:
            found |= self._further_drifts(sign_of_g1, samples, wanted, potential_at)
        none = np.full(len(samples), np.nan)
        return {name: found.get(name, none) for name in self.names}

    def _drifts(
        self,
        group: Group,
        energies: FloatArray,
        samples: FloatArray,
        wanted: IntArray,
        potential_at: Callable[[int], Potential],
    ) -> FloatArray:
        assert group.rests is not None
        drifts = drifts_of_many(self._body, group.program, group.rows, group.rests, energies, samples, wanted)
        for n in wanted[np.isnan(drifts[wanted, 0])].tolist():
            own = drifts_of(self._body, potential_at(n), samples[n], float(energies[n]), is_planar=True)
            drifts[n] = own.energy, own.geometric, own.areas
        return drifts

    def _further_drifts(
        self, sign: Sign, samples: FloatArray, wanted: IntArray, potential_at: Callable[[int], Potential]
    ) -> dict[str, FloatArray]:
        integrals: dict[int, FurtherIntegral] = {}
        for n in wanted.tolist():
            # There is one at most.
            for integral in self._further_of(potential_at(n), sign):
                integrals[n] = integral
        values = further_drifts_of_many(integrals, samples)
        found: dict[str, FloatArray] = {}
        for n, integral in integrals.items():
            if np.isnan(values[n, 1]):
                values[n] = integral_drift(integral, samples[n])
            for k, name in enumerate((f"invariants.{integral.name}", f"invariants.{integral.name}.drift")):
                found.setdefault(name, np.full(len(samples), np.nan))[n] = values[n, k]
        return found

    def _further_of(self, potential: Potential, sign: Sign) -> tuple[FurtherIntegral, ...]:
        known = self._known
        if known is None or known[0] is not potential or known[1] != sign:
            self._known = potential, sign
            self._further = find_further_integrals(self._body, potential, g1_sign=sign)
        return self._further
