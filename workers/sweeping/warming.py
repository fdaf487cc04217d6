"""Solves small problems before the first job, so that no job waits until code is loaded or compiled.

The first call of a compiled function reads its machine code from the cache, or compiles it where there is
none. The problems here call those of every tier, of the families that jobs mostly ask for, and of sweeps.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from service.jobs.outcome import Refused
from workers.computation.compiled_code import own_folder
from workers.computation.compute import solve_document
from workers.computation.processor import libraries, processor
from workers.sweeping.chunk import compute_chunk

Document = Mapping[str, object]

_BASE: Document = MappingProxyType(
    {
        "body": {"A": "2", "C": "1"},
        "potential": {
            "type": "expression",
            "expression": "a*g1 + b/g3^2",
            "parameters": {"a": "-1", "b": "1/20"},
        },
        "motion": {"type": "planar", "lambda": "1"},
        "time": {"stop": "1", "samples": 2},
        "accuracy": {"tier": "draft"},
    }
)
_TIERS = ("draft", "standard", "high", "certified")
_OTHER_MOMENTS = {
    "body": {"A": "3", "C": "1"},
    "potential": {"type": "homogeneous", "A": ["-1/2", "0", "1", "1/5"], "B": ["-1/3"], "C": ["1/200"]},
    "motion": {"type": "planar", "lambda": "4/5"},
}
_OUTPUTS = ["period", "gamma", "omega", "invariants", "orientation"]

FIRST_PROBLEMS: Mapping[str, Document] = MappingProxyType(
    {
        **{
            tier: {**_BASE, "accuracy": {"tier": tier}} for tier in ("draft", "standard", "high", "certified")
        },
        "orientation": {**_BASE, "outputs": _OUTPUTS},
    }
)
"""What the fork server solves before its first fork."""
PROBLEMS: Mapping[str, Document] = MappingProxyType(
    {
        **FIRST_PROBLEMS,
        "through the poles": {
            **_BASE,
            "body": {"A": "2", "B": "3/2", "C": "1"},
            "potential": {"type": "gravity", "a": "-1"},
            "outputs": [*_OUTPUTS, "stability"],
        },
        "other moments": {**_BASE, **_OTHER_MOMENTS, "accuracy": {"tier": "high"}},
    }
)
"""What it has solved when it forks the children that stay."""
STATE: Document = MappingProxyType(
    {
        "body": {"A": "2", "B": "3/2", "C": "1"},
        "time": {"stop": "1", "samples": 2},
        "accuracy": {"tier": "draft"},
        "potential": {"type": "gravity", "a": "-1"},
        "motion": {"type": "state", "gamma": ["0.6", "0", "0.8"], "omega": ["0", "1", "0.1"]},
    }
)
"""Only children solve it: those of the second stage."""
STATES: Document = MappingProxyType(
    {
        "base": dict(STATE),
        "axes": [{"pointer": "/motion/omega/0", "values": ["0", "1/10"]}],
        "keep": ["energy"],
        "series": True,
    }
)
"""As above."""
SWEEP: Document = MappingProxyType(
    {
        "base": {
            **_BASE,
            "body": {"A": "2", "B": "2", "C": "1"},
            "outputs": ["period", "gamma", "omega", "invariants"],
        },
        "axes": [{"pointer": "/motion/lambda", "values": ["1", "2"]}],
        "keep": ["period", "invariants.energy.drift", "invariants.goriachev.drift"],
    }
)
"""With all that blocks have kernels for: this potential of this body has the integral of Goriachev."""


class WarmingError(Exception):
    """A warming problem was not solved."""


def warm_up() -> None:
    """Solve all warming problems in this process, and note that the compiled code is complete.

    Raises
    ------
    WarmingError
        A problem was refused; the message says which one, and why.
    Exception
        Any fault of a solver.
    """
    warm_up_before_forks()
    _solve("state", STATE)
    _sweep("states", STATES)
    note = _note()
    if note is not None:
        note.touch()


def warm_up_for_first_jobs() -> None:
    """Solve the warming problems that load what most jobs need. They start no thread."""
    for name, document in FIRST_PROBLEMS.items():
        _solve(name, document)


def warm_up_before_forks() -> None:
    """Solve all warming problems that start no thread."""
    for name, document in PROBLEMS.items():
        _solve(name, document)
    _sweep("sweep", SWEEP)


def is_compiled() -> bool:
    """Tell whether all compiled code is in its folder: some process has solved all warming problems here."""
    note = _note()
    return note is not None and note.exists()


def _solve(name: str, document: Document) -> None:
    outcome = solve_document(json.dumps(dict(document)))
    if isinstance(outcome, Refused):
        raise WarmingError(f"{name}: {outcome.error.get('code')}: {outcome.error.get('detail')}")


def _sweep(name: str, document: Document) -> None:
    chunk = compute_chunk(json.dumps({"sweep": dict(document), "first": 0, "count": 2}))
    if chunk.refused:
        raise WarmingError(f"{name}: a point was refused")


def _note() -> Path | None:
    """Return the file that says so for this processor and these libraries; None without a folder."""
    folder = own_folder()
    return None if folder is None else folder / f"complete-{_here()}"


def _here() -> str:
    return hashlib.sha256(f"{processor()}\n{libraries()}".encode()).hexdigest()[:16]
