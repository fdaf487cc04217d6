"""Finds what belongs to a path by its shape: a request is compared with the few paths that look alike.

The shape of a path is the number of its parts and the first two of them: /v1/jobs/ID has that of
/v1/jobs/{job_id}. No template has a parameter in those two.
"""

from collections.abc import Iterable, Sequence
from typing import Generic, TypeVar

T = TypeVar("T")
_NAMED = 3
"""Parts that the shape spells out; the first is empty, in front of the slash that begins a path."""


class ByShape(Generic[T]):
    """Things that belong to templates of paths.

    Parameters
    ----------
    rows
        Template and thing; the order is kept among things of one shape.
    """

    def __init__(self, rows: Iterable[tuple[str, T]]) -> None:
        self._things: dict[tuple[int, str], list[T]] = {}
        for template, thing in rows:
            self._things.setdefault(_shape(template), []).append(thing)

    def of(self, path: str) -> Sequence[T]:
        """Return the things of the templates that look like ``path``; others cannot match it."""
        return self._things.get(_shape(path), ())


def _shape(path: str) -> tuple[int, str]:
    parts = path.split("/")
    return len(parts), "/".join(parts[:_NAMED])
