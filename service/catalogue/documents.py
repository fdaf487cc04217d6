"""Helpers that the documents of the catalogue share."""

YEHIA = (
    "H. M. Yehia, New solvable problems in the dynamics of a rigid body "
    "about a fixed point in a potential field"
)


def planar_example(
    body: dict[str, object],
    potential: dict[str, object],
    motion: dict[str, object],
    time: dict[str, object] | None = None,
) -> dict[str, object]:
    """Return a problem document: a planar motion, by default over two periods."""
    return {
        "body": body,
        "potential": potential,
        "motion": {"type": "planar", **motion},
        "time": time or {"periods": 2, "samples": 401},
        "outputs": ["gamma", "omega", "invariants"],
    }
