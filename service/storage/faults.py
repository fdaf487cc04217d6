"""A switch for tests: a process that dies at a chosen commit.

``POLHODE_FAULT=commit:before:3`` kills the process with SIGKILL when it is about
to commit its third transaction, ``commit:after:3`` as soon as it has. Nothing
is written, said or released on the way: so does a power cut, at the two
moments between which everything is decided. Unset, which it is outside of
tests, nobody ever looks at it again.
"""

import os
import signal
from typing import Literal, get_args

VARIABLE = "POLHODE_FAULT"

Moment = Literal["before", "after"]


class Fault:
    """Kills this process at the ``number``-th time that ``moment`` comes."""

    def __init__(self, moment: Moment, number: int) -> None:
        self._moment = moment
        self._left = number

    def reach(self, moment: Moment) -> None:
        """Say that the moment has come."""
        if moment == self._moment:
            self._left -= 1
            if self._left == 0:
                os.kill(os.getpid(), signal.SIGKILL)


def chosen_fault() -> Fault | None:
    """Return the fault that the environment asks for.

    Raises
    ------
    ValueError
        The variable is set to something else: a test would prove nothing.
    """
    wish = os.environ.get(VARIABLE)
    if wish is None:
        return None
    for moment in get_args(Moment):
        prefix = f"commit:{moment}:"
        if wish.startswith(prefix):
            return Fault(moment, int(wish.removeprefix(prefix)))
    raise ValueError(f"{VARIABLE}={wish}: accepted are commit:before:N and commit:after:N")
