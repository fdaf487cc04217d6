"""What the service around the solvers costs: verdicts, the start, the round trip of a job."""

import statistics
import tempfile
import time
from functools import partial
from pathlib import Path

from service.dynamics.verdict.verdict import decide
from tests.benchmarks.measuring import Effort, Table, in_words, median
from tests.support.planar import body, formula
from tests.support.serving import serving

EIGHT_TERMS = (
    "-2*g1 + (8*g1*(g1^2+g3^2) + g3^4/g1)/20"
    " + (16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3)/200"
    " + 1/(50*g3^2) + (g1^2-g3^2)/(500*g3^6) + (2*g1^4-2*g1^2*g3^2+g3^4)/(4000*g3^10)"
    " + (g1^2-g2^2)/5 + g2^2*(2*g1^2+g3^2)/10"
)
FORMULAS = {"eight terms": EIGHT_TERMS, "-g1": "-g1", "-g1 + 1e-30 g1 g2": "-g1 + 1e-30*g1*g2"}


def around(effort: Effort) -> Table:
    """Return the times of verdicts, of the start of the service, and of small jobs over HTTP."""
    rigid_body, rows = body(2, 1), []
    for name, text in FORMULAS.items():
        potential = formula(text, rigid_body)
        seconds = median(partial(decide, rigid_body, potential), effort.repeats(15))
        rows.append((f"verdict on {name}", in_words(seconds)))
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as running:
        rows.append(("polhode serve until ready", in_words(running.seconds_to_ready)))
        times = []
        for k in range(effort.repeats(40)):
            # Each problem is new, or the answer would come from the database.
            problem = {
                "body": {"A": 2, "C": 1},
                "potential": {"type": "gravity", "a": f"-{1000 + k}/1000"},
                "motion": {"type": "planar", "nu": 1},
                "time": {"periods": 1, "samples": 101},
            }
            began = time.perf_counter()
            answer = running.call("POST", "/v1/jobs", problem, Prefer="wait=10")
            times.append(time.perf_counter() - began)
            assert answer.document["state"] == "succeeded"
    rows.append(("POST /v1/jobs until the solution, idle service", in_words(statistics.median(times))))
    rows.append((f"the slowest of {len(times)}", in_words(max(times))))
    return Table("Around the solvers", "Verdicts are medians of warm calls.", ("what", "time"), tuple(rows))
