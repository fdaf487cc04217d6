"""The way of a sweep: what is sooner done, and what can be done at all."""

import pytest

from service.jobs.kernels import KERNELS, PLAIN_POINT_SECONDS, Kernels, most_missing, way_of_sweep

PLANAR = {"base": {"motion": {"type": "planar", "lambda": 1}, "accuracy": {"tier": "high"}}}
STATE = {"type": "state", "gamma": [1, 0, 0], "omega": [0, 0, 1]}


def states(**accuracy):
    return {"base": {"motion": STATE, "accuracy": accuracy}}


@pytest.mark.parametrize("document", [PLANAR, states(tier="high"), {}])
def test_with_all_kernels_every_sweep_is_compiled(document):
    assert way_of_sweep(document, 1, None) == "compiled"


def test_a_sweep_goes_the_plain_way_if_it_is_sooner_done_so():
    seconds = 40.0
    most = int(seconds / PLAIN_POINT_SECONDS)
    assert way_of_sweep(PLANAR, most, Kernels(1, 2, seconds)) == "plain"
    assert way_of_sweep(PLANAR, most + 1, Kernels(1, 2, seconds)) == "compiled"


def test_small_sweeps_go_at_once_and_large_ones_wait_while_nobody_knows_how_long_compiling_takes():
    assert way_of_sweep(PLANAR, 200, Kernels(0, KERNELS, None)) == "plain"
    assert way_of_sweep(PLANAR, 100_000, Kernels(0, KERNELS, None)) == "compiled"


def test_where_kernels_never_come_nothing_waits():
    never = Kernels(0, KERNELS, None, "no folder")
    assert way_of_sweep(PLANAR, 100_000, never) == "plain"
    assert way_of_sweep(states(tier="high"), 1, never) == "plain"


@pytest.mark.parametrize(
    ("accuracy", "way"),
    [
        ({"tier": "draft"}, "plain"),
        ({"tier": "standard"}, "plain"),
        ({"tier": "high"}, "compiled"),
        ({"tolerance": 1e-12}, "compiled"),
        ({"tolerance": "1e-12"}, "compiled"),
        ({"tolerance": 1e-9}, "plain"),
    ],
)
def test_states_that_only_kernels_know_so_well_wait(accuracy, way):
    assert way_of_sweep(states(**accuracy), 2, Kernels(0, KERNELS, None)) == way


@pytest.mark.parametrize("kernels", [Kernels(3, 9, 1.5), Kernels(3, 9, None), Kernels(0, 9, None, "no disk")])
def test_they_are_read_as_they_were_written(kernels):
    assert Kernels.read(kernels.document()) == kernels


@pytest.mark.parametrize("wrong", [{}, {"done": 1}, {"done": "1", "of": 2}])
def test_anything_else_is_refused(wrong):
    with pytest.raises(TypeError):
        Kernels.read(wrong)


def test_the_worker_that_has_most_to_do_is_told_and_one_that_never_will_before_it():
    one, other, never = Kernels(3, 9, 1.0), Kernels(1, 9, 1.0), Kernels(8, 9, None, "no disk")
    assert most_missing([]) is None
    assert most_missing([one, other]) == other
    assert most_missing([one, never, other]) == never
