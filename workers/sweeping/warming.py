"""Solves small problems before the first job, so that no job waits until code is loaded.

The first call of a kernel reads its machine code from the folder; the compiling task has it compiled where it
is missing. The problems here call the kernels of every tier, of the families that jobs mostly ask for, of
sweeps, and of motions from any state.
"""

import json
from collections.abc import Mapping
from types import MappingProxyType

from service.dynamics.accuracy import TIERS
from service.jobs.records import Refused
from workers.computation.compiled_code import GROUPS, Group, is_ready, keep_compiled_code, note_of
from workers.computation.compute import solve_document
from workers.solvers.ways import Way
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
_OTHER_MOMENTS = {
    "body": {"A": "3", "C": "1"},
    "potential": {"type": "homogeneous", "A": ["-1/2", "0", "1", "1/5"], "B": ["-1/3"], "C": ["1/200"]},
    "motion": {"type": "planar", "lambda": "4/5"},
}
_OUTPUTS = ["period", "gamma", "omega", "invariants", "orientation"]

FIRST_PROBLEMS: Mapping[str, Document] = MappingProxyType(
    {
        **{tier: {**_BASE, "accuracy": {"tier": tier}} for tier in TIERS},
        "orientation": {**_BASE, "outputs": _OUTPUTS},
    }
)
"""Problems that the fork server solves before its first fork."""
PROBLEMS: Mapping[str, Document] = MappingProxyType(
    {
        **FIRST_PROBLEMS,
        "through the poles": {
            **_BASE,
            "body": {"A": "2", "B": "3/2", "C": "1"},
            "potential": {"type": "gravity", "a": "-1"},
            "outputs": [*_OUTPUTS, "stability"],
        },
        "next to an end": {
            **_BASE,
            "motion": {"type": "planar", "lambda": "1", "start": {"g1": "1000001/10000000"}},
            "accuracy": {"tier": "high"},
        },
        "other moments": {**_BASE, **_OTHER_MOMENTS, "accuracy": {"tier": "high"}},
    }
)
"""Problems that it has solved when it forks the children that stay."""
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
BOTH: Document = MappingProxyType(
    {**_BASE, "body": STATE["body"], "potential": STATE["potential"], "method": "both"}
)
"""A planar motion is integrated by single steps. As above."""
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


_PROBLEMS_OF: Mapping[Group, Mapping[str, Document]] = MappingProxyType(
    {
        "planar": FIRST_PROBLEMS,
        "outputs": {name: each for name, each in PROBLEMS.items() if name not in FIRST_PROBLEMS},
        "sweeps": {"sweep": SWEEP},
        "states": {"state": STATE, "both": BOTH, "states": STATES},
    }
)


class WarmingError(Exception):
    """A warming problem was not solved."""


def warm_up() -> None:
    """Solve all warming problems in this process.

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


def compile_group(group: Group) -> None:
    """Solve the warming problems that need these kernels, by kernels, and note that they are all there.

    Raises as :func:`warm_up` does, and :class:`.ways.NotReadyError` where this process does not compile.
    """
    keep_compiled_code()
    for name, document in _PROBLEMS_OF[group].items():
        if "base" in document:
            _sweep(name, document, "compiled")
        else:
            _solve(name, document, "compiled")
    note = note_of(group)
    if note is not None:
        note.touch(mode=0o600)


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
    """Tell whether all compiled code is in its folder."""
    return is_ready(*GROUPS)


def _solve(name: str, document: Document, way: Way | None = None) -> None:
    outcome = solve_document(json.dumps(dict(document)), way=way)
    if isinstance(outcome, Refused):
        raise WarmingError(f"{name}: {outcome.error.get('code')}: {outcome.error.get('detail')}")


def _sweep(name: str, document: Document, way: Way | None = None) -> None:
    chunk = compute_chunk(json.dumps({"sweep": dict(document), "first": 0, "count": 2, "way": way}))
    if chunk.refused:
        raise WarmingError(f"{name}: a point was refused")
