"""Families of potentials that cost alike, as the table of accuracy and speed has them."""

from service.dynamics.accuracy import Family
from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.three_terms import recognise

MOST_PRODUCTS = 500
"""Three terms in the forms that people write take some ten; a formula that was made to cost must not."""


def family_of(body: RigidBody, potential: Potential) -> Family:
    """Return the family by the exact numbers of the potential, however it was written."""
    try:
        assert potential.tape
    except NoClosedFormError:
        return "integral"
    if recognise(body, potential, most_products=MOST_PRODUCTS) is not None:
        return "three-term"
    return "rational" if body.A == 2 * body.C else "general alpha"
