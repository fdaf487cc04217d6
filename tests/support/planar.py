"""Planar problems in few words, for tests."""

from collections.abc import Mapping
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Accuracy, PlanarMotion, Problem, TimeList, Times

Exact = int | str | Fraction


def body(A: Exact, C: Exact, B: Exact | None = None) -> RigidBody:
    return RigidBody(Fraction(A), None if B is None else Fraction(B), Fraction(C), allow_unphysical=True)


def formula(text: str, rigid_body: RigidBody, parameters: Mapping[str, Exact] | None = None) -> Potential:
    exact = {name: Fraction(value) for name, value in (parameters or {}).items()}
    return expression_potential(text, exact, rigid_body)


def planar(
    rigid_body: RigidBody,
    potential: Potential | str,
    motion: PlanarMotion,
    times: Times | tuple[Exact, ...] = (0, 1, 10),
    *,
    tolerance: float = 1e-10,
) -> Problem:
    if isinstance(potential, str):
        potential = formula(potential, rigid_body)
    if isinstance(times, tuple):
        times = TimeList(tuple(Fraction(t) for t in times))
    return Problem(
        rigid_body, potential, motion, times, Accuracy(tolerance), "quadrature", ("gamma", "omega")
    )
