"""What an atlas costs, beside the windows that are found λ by λ, which prove nothing between them."""

import json
from collections.abc import Callable
from fractions import Fraction
from functools import partial

import numpy as np

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import NoMotionError, find_windows
from service.schemas.atlas.documents import AtlasRequest, read_atlas
from service.verdicts.questions import examine_atlas
from tests.benchmarks.measuring import Effort, Table, in_turns, in_words

THREE_TERMS = {
    "body": {"A": 2, "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2 + c*(g1^2 - g2^2)",
        "parameters": {"a": -1, "b": "1/20", "c": "3/2"},
    },
    "lambda": ["1/2", 3],
}
WALL = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + (2*g1^2+g3^2)*2*exp(-100*(g2-3/10)^2)"},
    "lambda": ["1/2", 3],
}
ASKED = {"three terms": THREE_TERMS, "a wall": WALL}


def atlases(effort: Effort) -> Table:
    """Return seconds of whole answers of POST /v1/atlases in a warm process, without and with periods."""
    rows = []
    for name, document in ASKED.items():
        asked = read_atlas(document)
        ways: tuple[Callable[[], object], ...] = (
            partial(examine_atlas, json.dumps({**document, "outputs": []})),
            partial(examine_atlas, json.dumps(document)),
            partial(_one_by_one, asked),
        )
        rows.append((name, *(in_words(seconds) for seconds in in_turns(ways, effort.repeats(5)))))
    heads = ("potential", "atlas", "with periods", f"windows at {asked.samples} λ")
    remark = "The windows at single λ tell no change between them, and have neither energies nor periods."
    return Table("Atlases", remark, heads, tuple(rows))


def _one_by_one(asked: AtlasRequest) -> None:
    for lambda_ in np.geomspace(float(asked.range.lower), float(asked.range.upper), asked.samples):
        try:
            find_windows(asked.body, asked.potential, PlanarMotion(Fraction(float(lambda_))))
        except NoMotionError:
            continue
