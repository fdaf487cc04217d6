"""Fault injection for tests: kills the process at a chosen commit.

``POLHODE_FAULT=commit:before:3`` kills the process with SIGKILL when it is about
to commit its third transaction, ``commit:after:3`` as soon as it has. Like a power
cut, this writes and releases nothing; before and after a commit are the two moments
that differ. Outside of tests the variable is not set and nothing happens.
"""

import os
import signal
from typing import Literal, get_args

VARIABLE = "POLHODE_FAULT"

Moment = Literal["before", "after"]


class PlannedKill:
    """Kills this process at the ``number``-th time that ``moment`` comes."""

    def __init__(self, moment: Moment, number: int) -> None:
        self._moment = moment
        self._left = number

    def reach(self, moment: Moment) -> None:
        """Count a moment, and kill the process at the chosen one."""
        if moment == self._moment:
            self._left -= 1
            if self._left == 0:
                os.kill(os.getpid(), signal.SIGKILL)


def chosen_fault() -> PlannedKill | None:
    """Return the fault that the environment asks for.

    Raises
    ------
    ValueError
        The variable has another value: a test that relied on it would prove nothing.
    """
    wish = os.environ.get(VARIABLE)
    if wish is None:
        return None
    for moment in get_args(Moment):
        prefix = f"commit:{moment}:"
        if wish.startswith(prefix):
            return PlannedKill(moment, int(wish.removeprefix(prefix)))
    raise ValueError(f"{VARIABLE}={wish}: accepted are commit:before:N and commit:after:N")
