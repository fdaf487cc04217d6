"""The cost that sweeps are expected to have by ``POST /v1/sweeps?estimate=true``, beside what they cost."""

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.packing import encode_points
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.benchmarks.whole.points import MOST, OUTPUTS, axis, sweep_of, sweeps
from tests.support.serving import serving
from workers.sweeping.chunk import ChunkSolver
from workers.sweeping.plan import make_plan

WARM = 8
STRETCHES = 4
"""Parts of a sweep that are computed where all of it would take too long."""
TELLING = 100
FACTOR = 3.0
"""Asked: neither is the estimate larger than so many times the truth, nor the truth than the estimate."""
_STATE = {"type": "state", "omega": ["1/2", "1/10", 1], "gamma": ["3/5", 0, "4/5"]}
_STATES = [axis("/motion/omega/0", "1/10", "9/10")]
_KNOWN = (
    "1e-9",
    "high",
    "stability kept",
    "without a motion",
    "A, C, a coefficient and λ, drawn",
    "the end of the times",
    "signs and λ",
    "from any state",
)


def documents() -> Mapping[str, Mapping[str, object]]:
    """Return the sweeps, by name."""
    known = sweeps()
    return {
        **{name: known[name] for name in _KNOWN},
        "two coefficients": sweep_of(
            axes=[axis("/potential/parameters/a", -2, -1), axis("/potential/parameters/b", "1/30", "1/10")]
        ),
        "α = 1.7": sweep_of(
            body={"A": "17/10", "C": 1},
            potential={"type": "homogeneous", "A": [0], "B": [-1], "C": ["1/20"]},
        ),
        "series of 1000 samples": {**sweep_of(time={"stop": 10, "samples": 1000}), "series": True},
        "certified": sweep_of(accuracy={"tier": "certified"}),
        "method both": sweep_of(method="both"),
        "orientation at the tier high": sweep_of(
            ("precession.psi1",), outputs=[*OUTPUTS, "orientation"], accuracy={"tier": "high"}
        ),
        "any state, to t = 100": sweep_of(axes=_STATES, motion=_STATE, time={"stop": 100, "samples": 101}),
        "an integral as potential": sweep_of(
            potential={"type": "general", "F": "exp(-w)", "G": "-g2^2", "parameters": {}}
        ),
    }


def estimates(effort: Effort) -> Table:
    """Return estimates of a service, beside the processor time of computing the same points."""
    rows = []
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), workers=0) as running:
        for name, document in documents().items():
            began = time.perf_counter()
            answer = running.call("POST", "/v1/sweeps?estimate=true", document)
            took = time.perf_counter() - began
            assert answer.status == 200, answer
            found = answer.document
            seconds, stored = truth(document, effort)
            ratio = found["seconds"] / seconds
            name = name if 1.0 / FACTOR <= ratio <= FACTOR else f"**{name}, missed**"
            times = in_words(found["seconds"]), in_words(seconds), f"{ratio:.2g}×", in_words(took)
            rows.append((name, *times, f"{found['bytes'] / 1e3:,.0f} kB", stored))
    remark = (
        "Processor time of one worker for all points, of long sweeps from parts of them; bytes of chunks"
        f" of at least {TELLING} points."
        f" Asked: within a factor of {FACTOR:g}."
    )
    heads = ("sweep", "estimate", "truth", "ratio", "asked in", "bytes", "truth")
    return Table("Estimates of sweeps", remark, heads, tuple(rows))


def truth(document: Mapping[str, object], effort: Effort) -> tuple[float, str]:
    """Return the processor seconds and the bytes of a whole sweep."""
    sweep = read_sweep(document, max_points=MOST * MOST)
    solver = ChunkSolver(make_plan(sweep))
    solver.solve(0, WARM, time.perf_counter() + 60.0)
    seconds, points, stored = 0.0, 0, 0
    for first in np.linspace(0, sweep.points, STRETCHES, endpoint=False).astype(int).tolist():
        began, until = time.process_time(), time.perf_counter() + 0.1 * effort.repeats(10)
        found = solver.solve(first, min(sweep.points // STRETCHES, 1000), until)
        seconds += time.process_time() - began
        stored += len(encode_points(found))
        points += len(found.outcomes)
    # A packet of few points is mostly its header.
    size = f"{stored * sweep.points / points / 1e3:,.0f} kB" if points > STRETCHES * TELLING else "—"
    return seconds * sweep.points / points, size
