"""Pictures of motions: a figure for a paper and an animation, as files and in notebooks."""

import itertools
import os
import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from PIL import Image

import polhode as ph
from polhode import drawing

STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": 1, "c": "-1/2"},
    "motion": {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 5, "samples": 6},
}


@pytest.fixture
def motion(connected, base):
    return connected.solve(base)


def labels_of(ax):
    return {text.get_text() for text in ax.texts}


def test_a_figure_is_ready_for_a_paper(motion):
    figure = motion.figure()
    upper, lower, sphere = figure.axes[:3]
    assert lower.get_xlabel().startswith("time $t$ in ")
    assert all(ax.get_ylabel() for ax in (upper, lower))
    # Names stand beside the curves: that of q, which is 0 for ever, is left out.
    assert labels_of(upper) == {rf"$\gamma_{k}$" for k in (1, 2, 3)}
    assert labels_of(lower) == {"$p$", "$r$"}
    assert [ax.get_legend() for ax in figure.axes] == [None] * len(figure.axes)
    figure.draw_without_rendering()
    for ax in (upper, lower):
        boxes = [text.get_window_extent() for text in ax.texts]
        assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
        # One period, to its end, and not more.
        assert ax.get_xlim() == pytest.approx((0, float(motion.period)), rel=1e-12)
        assert all(box.x0 >= ax.get_window_extent().x1 for box in boxes)
    # The second scale of time counts periods.
    (turns,) = upper.child_axes
    assert turns.get_xlim() == pytest.approx((0, 1), rel=1e-12)
    # A circle around all that is drawn of the sphere.
    path = np.concatenate([line.get_xydata() for line in sphere.lines])
    assert np.hypot(*path.T).max() <= 1 + 1e-12


def test_a_motion_without_a_period_has_all_six_variables(connected):
    figure = connected.solve(STATE).figure()
    assert labels_of(figure.axes[1]) == {"$p$", "$q$", "$r$"}
    assert figure.axes[0].child_axes == []


def test_the_sphere_is_a_projection_and_its_parts_are_the_path(motion):
    gamma = motion.at(np.linspace(0, float(motion.period), 200)).gamma
    flat = drawing.seen(gamma)
    towards = drawing._view()[2]
    # Orthogonal: what is left out is the distance to the viewer.
    np.testing.assert_allclose((flat**2).sum(axis=1) + (gamma @ towards) ** 2, 1.0, atol=1e-12)
    parts = list(drawing.sphere_parts(gamma))
    # Each but the last one ends with the first point of the next.
    joined = np.concatenate([points[:-1] for points, _ in parts[:-1]] + [parts[-1][0]])
    np.testing.assert_array_equal(joined, flat)
    assert {is_front for _, is_front in parts} == {True, False}
    assert all(one != other for (_, one), (_, other) in itertools.pairwise(parts))


def test_figures_are_written_as_svg_and_pdf(motion, tmp_path):
    motion.figure(tmp_path / "motion.svg")
    assert ET.parse(tmp_path / "motion.svg").getroot().tag.endswith("svg")
    motion.figure(str(tmp_path / "motion.pdf"))
    assert (tmp_path / "motion.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(ph.WrongArgumentError, match=r"\.pdf.*accepted"):
        motion.figure(tmp_path / "motion.doc")


def test_an_animation_is_a_gif_or_a_page(motion, tmp_path):
    file = motion.animate(tmp_path / "motion.gif", frames=3, seconds=0.3)
    with Image.open(file) as gif:
        assert gif.n_frames == 3
        frames = []
        for k in range(3):
            gif.seek(k)
            frames.append(gif.convert("RGB").tobytes())
    assert len(set(frames)) == 3
    page = motion.animate(tmp_path / "motion.html", frames=2)
    assert page.read_text().count("data:image/png;base64") == 2
    shown = motion.animate(frames=2)
    assert isinstance(shown, drawing.Animation)
    assert "data:image/png;base64" in shown._repr_html_()


def test_what_cannot_be_an_animation_is_told(motion, tmp_path, monkeypatch):
    for wrong in ({"frames": 1}, {"frames": 401}, {"frames": 2.5}, {"seconds": 0}, {"seconds": float("nan")}):
        with pytest.raises(ph.WrongArgumentError, match="accepted"):
            motion.animate(**wrong)
    with pytest.raises(ph.WrongArgumentError, match=r"is no animation; files that end in \.gif"):
        motion.animate(tmp_path / "motion.avi")
    monkeypatch.setenv("PATH", os.devnull)
    with pytest.raises(ph.WrongArgumentError, match="MP4 needs ffmpeg"):
        motion.animate(tmp_path / "motion.mp4")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_an_animation_is_a_film_where_there_is_ffmpeg(motion, tmp_path):
    file = motion.animate(tmp_path / "motion.mp4", frames=3)
    assert file.read_bytes()[4:8] == b"ftyp"
