"""The panels of half a loop leave nothing out, and their nodes lie in them."""

import numpy as np

from workers.solvers.compiled.windows.signs import (
    BEGINS,
    EDGES,
    ENDS,
    HALF_WIDTHS,
    MIDDLE_COSINES,
    MIDDLE_SINES,
    NODE_COSINES,
    NODE_SINES,
    NODES,
    PANELS,
    SIDES,
)


def angle(away):
    """Return v, which grows from pole to pole, of a distance to the nearer pole."""
    return np.where(SIDES > 0, away, np.pi - away)


def test_panels_adjoin_from_the_cell_at_one_pole_to_that_at_the_other():
    low, high = angle(BEGINS), angle(ENDS)
    assert len(low) == PANELS
    assert np.all(low < high)
    # A rounding of π − v.
    np.testing.assert_allclose(high[:-1], low[1:], rtol=0, atol=1e-15)
    np.testing.assert_allclose([low[0], high[-1]], [EDGES[0], np.pi - EDGES[0]], rtol=0, atol=1e-15)


def test_nodes_lie_in_their_panels():
    places = np.arctan2(NODE_SINES, NODE_COSINES).reshape(PANELS, NODES)
    middles = np.arctan2(MIDDLE_SINES, MIDDLE_COSINES)
    # Two roundings of an angle of at most π.
    assert np.all(np.abs(places - middles[:, None]) <= HALF_WIDTHS[:, None] + 1e-15)
