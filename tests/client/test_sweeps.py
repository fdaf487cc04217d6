"""Sweeps and lists over the live service."""

import io
import json
import zipfile

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import polhode as ph
from polhode.listings import _SHOWN


@pytest.fixture
def sweep(connected, base):
    """A grid of 5 by 3 points, of which those with a = 1 have no motion."""
    return connected.sweep(base, lam=ph.linspace(1, 2, 5), a=[-1, "-4/3", 1], keep=["period", "energy"])


def test_a_sweep_is_a_frame_an_array_and_points(connected, sweep):
    frame = sweep.frame()
    assert list(frame.columns) == ["index", "lambda", "a", "period", "energy", "outcome"]
    assert len(frame) == len(sweep) == sweep.done == 15
    assert frame["lambda"].tolist() == np.repeat([1, 1.25, 1.5, 1.75, 2], 3).tolist()
    array = sweep.array()
    assert dict(array.sizes) == {"lambda": 5, "a": 3}
    for row in frame.itertuples():
        there = array.period.sel({"lambda": frame["lambda"][row.Index], "a": row.a}).item()
        assert there == row.period or (np.isnan(there) and np.isnan(row.period))
    assert np.array_equal(sweep.values("energy"), array.energy.to_numpy(), equal_nan=True)
    filtered = sweep.frame("period>5", order="-period")
    assert filtered.period.tolist() == sorted(frame.period[frame.period > 5], reverse=True)
    again = connected.stored_sweep(sweep.id)
    assert again.frame().equals(frame)


def test_a_sweep_is_a_package_to_publish(sweep, tmp_path):
    file = sweep.package(tmp_path / "sweep.zip")
    with zipfile.ZipFile(file) as package:
        assert set(package.namelist()) == {"datapackage.json", "points.parquet", "sweep.json"}
        points = pq.read_table(io.BytesIO(package.read("points.parquet")))
        assert json.loads(package.read("sweep.json"))["axes"] == sweep.state["document"]["axes"]
    assert points.column("period").to_numpy().tolist()[:3] == pytest.approx(
        sweep.frame().period[:3].tolist(), abs=0, nan_ok=True
    )


def test_a_point_is_a_problem_of_its_own(sweep, base):
    point = sweep[-11]  # λ = 1.25, a = -4/3
    assert point.index == 4
    row, motion = point.row(), point.motion()
    assert motion.problem["potential"]["parameters"] == {"a": "-4/3", "b": "1/20"}
    assert motion.problem["motion"]["lambda"] == 1.25
    assert motion.problem["accuracy"] == base["accuracy"]
    # One processor, one numerics: bit by bit, as docs/sweeps.md promises.
    assert (float(motion.period), float(motion.energy)) == (row["period"], row["energy"])
    with pytest.raises(IndexError):
        sweep[15]


def test_axes_are_series_and_points_come_in_slices(connected, base):
    frame = pd.DataFrame({"lam": [1.0, 1.25, 1.5], "a": [-1, -2, -3]}, index=[7, 8, 9])
    sweep = connected.sweep(base, lam=frame.lam, a=frame.a, combine="zip", series=np.bool_(False))
    assert sweep.frame()["lambda"].tolist() == frame.lam.tolist()
    assert [point.index for point in sweep[1:]] == [1, 2]
    assert [point.index for point in sweep[::-2]] == [2, 0]
    assert sweep[np.int64(-1)].problem()["potential"]["parameters"]["a"] == -3
    with pytest.raises(ph.WrongArgumentError, match="an integer"):
        sweep[1.0]


def test_points_without_a_motion_say_why(sweep):
    frame = sweep.frame("outcome!=solved")
    assert len(frame) == sweep.refused
    assert set(frame.outcome) <= {"no_motion"}


def test_a_heatmap_needs_two_axes(connected, base, sweep):
    ax = sweep.heatmap("period")
    assert {ax.get_xlabel(), ax.get_ylabel()} == {"lambda", "a"}
    line = connected.sweep(base, lam=[1, 2], b=["1/20", "1/10"], combine="zip")
    assert list(line.array().dims) == ["index"]
    with pytest.raises(ph.WrongArgumentError, match="two axes"):
        line.heatmap("period")
    with pytest.raises(ph.WrongArgumentError, match="did you mean 'period'"):
        sweep.heatmap("perriod")


def test_mistakes_in_axes_are_told(connected, base):
    with pytest.raises(ph.WrongArgumentError, match="did you mean 'lam'"):
        connected.sweep(base, lamb=[1, 2])
    with pytest.raises(ph.WrongArgumentError, match="is no axis"):
        connected.sweep(base, lam=3)
    with pytest.raises(ph.RefusedError) as refused:
        connected.sweep(base, lam=[1, 2], keep=["perod"])
    assert refused.value.pointer == "/keep/0"


def test_progress_is_told_up_to_the_end(service, base):
    told = []
    with ph.connect(service.address, progress=told.append) as client:
        client.sweep(base, lam=ph.linspace(1, 3, 50))
    assert (told[-1].done, told[-1].total, told[-1].is_over) == (50, 50, True)
    assert [each.done for each in told] == sorted(each.done for each in told)


def test_lists_are_paged_by_cursors(connected, base, monkeypatch):
    lambdas = [1 + k / 64 for k in range(8)]
    connected.solve_all([ph.problem(base, lam=each) for each in lambdas])
    listing = connected.solutions("/motion/lambda>=1, /motion/lambda<1.12", order="/motion/lambda")
    ids = [motion.id for motion in listing]
    monkeypatch.setattr("polhode.listings._PAGE", 3)
    assert [motion.id for motion in listing] == ids
    assert listing.count() == len(ids) == len(listing.all()) >= 8
    frame = listing.frame(["id", "period", "/motion/lambda", "created_at"])
    assert frame.id.tolist() == ids
    assert frame["/motion/lambda"].is_monotonic_increasing
    assert frame.created_at.dt.tz is not None
    assert len(listing.frame(limit=2)) == 2
    assert connected.jobs("state=succeeded").count() >= 8
    shown = listing._repr_html_()
    assert shown.count("<tr>") == 1 + min(len(ids), _SHOWN)
    assert all(
        each in shown
        for each in ("<th style='text-align:left'>period</th>", ids[0], f"solutions: {len(ids)}")
    )
    monkeypatch.setattr("polhode.listings._SHOWN", 2)
    assert listing._repr_html_().count("<tr>") == 3
    assert f"{len(ids)}, of which 2" in listing._repr_html_()
    assert repr(connected.jobs("state=failed")) == "<list of jobs: where state=failed>"
