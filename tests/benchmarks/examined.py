"""What the examination of a new problem takes, in lists and alone."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import count

from service.verdicts.examination import examine_problems
from tests.benchmarks.cached_examinations import forgetful
from tests.benchmarks.lists import GENERAL
from tests.benchmarks.measuring import Effort, Table, in_turns, in_words
from tests.benchmarks.whole.requests import PROBLEM
from tests.support.examinations import examination_of

TOGETHER = 50
"""As many problems as the service examines by one call."""
LARGEST_MS = {"gravity": 0.4, "α = 1.7": 1.5}
"""Asked of a problem in a list, each with its own λ."""

Document = Mapping[str, object]


def examined(effort: Effort) -> Table:
    """Return the processor's time for a problem: with another λ each, and with another number in V each."""
    rows = []
    for name, curves, potentials in (
        ("gravity", _gravity_on_curves(), _gravities()),
        ("α = 1.7", _general_on_curves(), _generals()),
    ):
        repeats = effort.repeats(25)
        asked = ((curves, TOGETHER), (curves, 1), (potentials, TOGETHER))
        ways = tuple(forgetful(_examine(*each, repeats)) for each in asked)
        together, alone, different = in_turns(ways, repeats, time.process_time)
        seconds = (together / TOGETHER, alone, different / TOGETHER)
        rows.append((name, *map(in_words, seconds), f"≤ {LARGEST_MS[name]} ms"))
    remark = (
        f"Nothing is kept, and every problem is new. The list has {TOGETHER} problems, as the service "
        "examines them by one call: of one potential, with a λ each, or with a potential each. By the "
        "processor's time, of one problem, its document read and its windows written."
    )
    heads = ("problem", "in a list, another λ", "alone", "in a list, another potential", "asked of the first")
    return Table("Examination of new problems", remark, heads, tuple(rows))


def _examine(documents: Iterator[Document], number: int, repeats: int) -> Callable[[], object]:
    """Return what examines so many further problems, whose texts are made beforehand."""
    texts = [json.dumps(examination_of([next(documents) for _ in range(number)])) for _ in range(repeats + 1)]
    waiting = iter(texts)
    return lambda: examine_problems(next(waiting))


def _gravity_on_curves() -> Iterator[Document]:
    return ({**PROBLEM, **_curve(f"{200_000 + k}/100000")} for k in count())


def _general_on_curves() -> Iterator[Document]:
    return ({**GENERAL, **_curve(f"{80_000 + k}/100000")} for k in count())


def _gravities() -> Iterator[Document]:
    return (
        {**PROBLEM, **_curve("2"), "potential": {"type": "gravity", "a": f"-{10_000 + k}/10000"}}
        for k in count()
    )


def _generals() -> Iterator[Document]:
    formula = "(A*g1^2+C*g3^2)*({}/10000*g2^2-1/2+g2^3/5)"
    return (
        {
            **GENERAL,
            **_curve("4/5"),
            "potential": {"type": "expression", "expression": formula.format(10_000 + k)},
        }
        for k in count()
    )


def _curve(lambda_: str) -> Document:
    return {"motion": {"type": "planar", "lambda": lambda_}}
