"""What was examined before is not examined again: in this process, in the next one, for another problem."""

import asyncio
import json

import pytest

from service.api.verdicts.examiner import CachedExaminations, Examiner, Submission
from service.api.verdicts.verdict_queue import Claimant
from service.schemas.problem.problem import check_problem
from service.storage.examinations import ExaminationStore, keys_of
from service.verdicts import cached
from tests.support.api import PLANAR

pytestmark = pytest.mark.any_database

CLAIMANT = Claimant(None)
INADMISSIBLE = {**PLANAR, "potential": {"type": "expression", "expression": "g1*g2"}}


class InlineQueue:
    """Runs in this process what a child would run."""

    def __init__(self):
        self.asked = []

    async def ask(self, examination, text, claimant, *, crashes):
        self.asked.append(json.loads(text))
        return examination(text)


class Process:
    """An API process of the installation."""

    def __init__(self, database):
        self.store, self.queue = ExaminationStore(database), InlineQueue()
        self.memory = CachedExaminations(self.store)
        self.examiner = Examiner(self.queue, self.memory, self.store)

    def examine(self, *documents):
        return asyncio.run(self.examiner.examine([problem(each) for each in documents], CLAIMANT))


def problem(document):
    checked = check_problem(document)
    return Submission(document, checked, keys=keys_of(checked.canonical), text=json.dumps(document))


def on_curve(lambda_, **changes):
    return {**PLANAR, "motion": {"type": "planar", "lambda": lambda_}, **changes}


@pytest.fixture
def decided(monkeypatch):
    calls = []
    decide = cached.decide
    monkeypatch.setattr(cached, "decide", lambda *given: calls.append(given) or decide(*given))
    return calls


def test_an_equal_problem_is_answered_without_a_child(database):
    process = Process(database)
    assert process.examiner.known(problem(on_curve(1))) is None
    (found,) = process.examine(on_curve(1))
    again = process.examiner.known(problem(on_curve("1.0", time={"stop": 3, "samples": 9})))
    assert again is not None
    assert again.answer == found.answer
    assert {entry.key for entry in again.entries} == {entry.key for entry in found.entries}
    assert len(process.queue.asked) == 1


def test_another_process_starts_with_what_was_stored(database, decided):
    (found,) = Process(database).examine(on_curve(1))
    assert len(found.entries) == 2
    other = Process(database)
    other.store.add(found.entries)
    # Of an equal problem the verdict and the windows are there, of one on another curve the verdict.
    (same,) = other.examine(on_curve(1))
    (near,) = other.examine(on_curve(2))
    assert same.answer == found.answer
    assert [len(asked["cached"]) for asked in other.queue.asked] == [2, 1]
    assert len(decided) == 1
    assert {e.key for e in near.entries} & {e.key for e in found.entries} == {
        problem(on_curve(1)).keys.verdict
    }


def test_what_is_found_for_refused_problems_is_stored_at_once(database, decided):
    (found,) = Process(database).examine(INADMISSIBLE)
    assert found.answer["error"]["code"] == "inadmissible_potential"
    assert found.entries == ()
    (again,) = Process(database).examine(INADMISSIBLE)
    assert again.answer == found.answer
    assert len(decided) == 1


def test_refusals_are_not_answered_from_memory(database):
    process = Process(database)
    process.examine(INADMISSIBLE)
    assert process.examiner.known(problem(INADMISSIBLE)) is None


def test_hits_are_counted(database):
    process = Process(database)
    process.examine(on_curve(1))
    assert process.memory.counts == (0, 2)
    process.examine(on_curve(2))
    assert process.memory.counts == (1, 3)
