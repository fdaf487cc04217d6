"""Lists are examined on all processors, and one more child is left to others."""

import os

import pytest

from service.verdicts.starting import verdict_children


@pytest.mark.parametrize(("processors", "children"), [(1, 3), (2, 3), (8, 9), (128, 17)])
def test_there_is_a_child_for_each_processor_and_one_more(monkeypatch, processors, children):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(processors)))
    assert verdict_children() == children
