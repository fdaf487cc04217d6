"""The way of a job: by compiled kernels, or plain where their code is not ready; and who keeps that code.

Whoever may read files and the environment (:mod:`workers.computation.compiled_code`) says how code is kept,
before or after kernels were loaded. Until then nothing is kept: what is compiled is compiled for this process
alone.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Literal, Protocol  # Any: a kernel of numba, which has no types

Way = Literal["compiled", "plain"]
"""``plain``: no kernel is called. Other functions do the same, slower, and keep the same promises."""

_way: ContextVar[Way] = ContextVar("way", default="compiled")


class NotReadyError(Exception):
    """The code of a kernel is not there, and this process does not compile."""


def is_plain() -> bool:
    """Tell whether kernels are left alone: who would call one asks this first."""
    return _way.get() == "plain"


def current_way() -> Way:
    """Return the way that is gone now."""
    return _way.get()


@contextmanager
def on_way(way: Way) -> Iterator[None]:
    """Go this way inside the block."""
    before = _way.set(way)
    try:
        yield
    finally:
        _way.reset(before)


Kind = Literal["entry", "part"]
"""Compiled code is an entry, machine code that Python calls, or a part of entries."""


class Code(Protocol):
    """Keeps the code of a kernel, for types of its arguments."""

    def load(self, kind: Kind, types: object, context: Any) -> Any:  # noqa: ANN401
        """Return what was saved; None has it compiled."""

    def save(self, kind: Kind, types: object, context: Any, saved: object) -> None:  # noqa: ANN401
        """Keep it."""

    def first_number(self) -> int:
        """Return a number from which on this process may number functions, unlike any other."""


class Nowhere:
    """Keeps nothing."""

    def load(self, *_: object) -> None:
        """Return nothing."""

    def save(self, *_: object) -> None:
        """Do nothing."""

    def first_number(self) -> int:
        """Return 1: no other process meets these functions."""
        return 1


Keep = Callable[[Any], None]


class _Kernels:
    keep: Keep | None = None
    waiting: tuple[Any, ...] = ()


def made(kernel: Any) -> None:  # noqa: ANN401
    """Have the code of a new kernel kept: now, or as soon as somebody says how."""
    if _Kernels.keep is None:
        _Kernels.waiting += (kernel,)
    else:
        _Kernels.keep(kernel)


def keep_by(keep: Keep) -> None:
    """Say how the code of all kernels is kept."""
    _Kernels.keep = keep
    for kernel in _Kernels.waiting:
        keep(kernel)
    _Kernels.waiting = ()
