"""Groups potentials into families of similar cost, as in the table of accuracy and speed."""

from service.dynamics.accuracy import Family
from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.recognition.three_terms import recognise

MOST_PRODUCTS = 500
"""Usual three-term formulas need some ten products; the limit protects against costly formulas."""
FUNCTIONS = frozenset({"exp", "log", "sin", "cos", "tan"})
"""Functions that are no powers: their series have no end."""


def family_of(body: RigidBody, potential: Potential) -> Family:
    """Return the family of a potential, however its formula is written."""
    try:
        instructions = potential.tape.instructions
    except NoClosedFormError:
        return "integral"
    if recognise(body, potential, most_products=MOST_PRODUCTS) is not None:
        return "three-term"
    if any(each.operation == "general_power" or each.name in FUNCTIONS for each in instructions):
        return "function"
    return "rational" if body.A == 2 * body.C else "general alpha"
