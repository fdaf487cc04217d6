"""What is copied as curl and as Python runs as it is, and gives what the page shows."""

import csv
import io
import json
import re
import shlex
import subprocess
import sys
from urllib.parse import quote

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.support.browser import problem, settle

NUMBER = re.compile(r"-?\d+\.\d*(?:e[-+]\d+)?")
"""As NumPy prints it, with eight digits."""


@pytest.fixture
def copied(context, tab):
    """Press a button that copies, and return what is in the clipboard."""
    context.grant_permissions(["clipboard-read", "clipboard-write"])

    def press(name: str) -> str:
        done = tab.page.get_by_role("button", name="Copied")
        expect(done).to_have_count(0)  # what was copied before is told no more
        tab.page.get_by_role("button", name=name).click()
        expect(done).to_be_visible()
        return tab.page.evaluate("navigator.clipboard.readText()")

    return press


def by_curl(command: str) -> str:
    return subprocess.run(shlex.split(command), check=True, capture_output=True, text=True).stdout


def by_python(program: str) -> str:
    command = [sys.executable, "-c", program]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def test_the_problem_of_the_workbench(tab, copied):
    page = tab.open("workbench#" + quote(json.dumps(problem("first"))))
    settle(page)
    job = json.loads(by_curl(copied("Copy as curl")))
    assert job["state"] == "succeeded"
    solution = tab.site.service.call("GET", f"/v1/solutions/{job['solution']}").document
    told = by_python(copied("Copy as Python"))
    for name in ("period", "energy"):
        assert str(solution[name]["value"]) in told
    assert str(solution["error"]) in told


@pytest.mark.long
def test_a_stretch_of_a_solution(tab, copied):
    identity = tab.site.solutions["first"]
    # Typed as a fraction, which Python would divide as it likes.
    page = tab.open(f"solution?id={identity}&start=1/3&stop=7/3")
    expect(page.locator("#series-note")).to_contain_text("From 0.33333")
    rows = list(csv.DictReader(io.StringIO(by_curl(copied("Copy as curl")))))
    assert len(rows) == 800
    assert (float(rows[0]["t"]), float(rows[-1]["t"])) == (1 / 3, 7 / 3)
    page.get_by_label("from").fill("1/3")  # written over the double that stood there
    program = copied("Copy as Python")
    assert f"np.linspace({1 / 3!r}, {7 / 3!r}, 800)" in program
    shown = [float(word) for word in NUMBER.findall(by_python(program).split("]")[0])]
    assert np.allclose(shown, [float(rows[0][name]) for name in ("g1", "g2", "g3")], atol=1e-8)


@pytest.mark.long
def test_the_stored_samples_before_any_have_come(tab, copied):
    identity = tab.site.solutions["first"]
    tab.page.route("**/trajectory?preview=*", lambda _: None)  # never answered
    tab.open(f"solution?id={identity}")
    stored = tab.site.service.call("GET", f"/v1/solutions/{identity}/trajectory").document["columns"]["t"]
    rows = list(csv.DictReader(io.StringIO(by_curl(copied("Copy as curl")))))
    assert [float(row["t"]) for row in rows] == stored
    assert "motion.samples()" in copied("Copy as Python")


def test_the_points_of_a_sweep(tab, copied):
    page = tab.open(f"sweep?id={tab.site.sweep}")
    settle(page)
    expect(page.locator("#progress")).to_contain_text("72 of 72")
    page.locator("select[name=of]").select_option("energy")
    rows = list(csv.DictReader(io.StringIO(by_curl(copied("Copy as curl")))))
    assert len(rows) == 72
    shown = NUMBER.findall(by_python(copied("Copy as Python")))
    energies = [float(row["energy"]) for row in rows if row["energy"]]
    assert 0 < len(energies) == len(shown)
    assert np.allclose(sorted(map(float, shown)), sorted(energies), atol=1e-8)
