"""``polhode families``: the catalogue for people."""

import json

import pytest
from typer.testing import CliRunner

from service.catalogue import classical
from service.cli.commands import app

run = CliRunner().invoke


def test_it_lists_every_family_and_every_case_once():
    result = run(app, ["families"])
    lines = [line for line in result.stdout.splitlines() if line]
    names = [line.split()[0] for line in lines if line.startswith("  ")]
    assert len(lines) - len(names) == 3  # the headings
    assert result.exit_code == 0
    assert len(set(names)) == len(names)
    assert {"gravity", "kovalevskaya", *(case.case for case in classical())} <= set(names)


@pytest.mark.parametrize("name", [case.case for case in classical()])
def test_it_tells_all_of_a_case_with_its_example(name: str):
    (case,) = [case for case in classical() if case.case == name]
    result = run(app, ["families", name])
    assert result.exit_code == 0
    assert case.title in result.stdout
    assert case.real in result.stdout
    if case.example is not None:
        assert json.loads(result.stdout[result.stdout.index("{\n") :]) == case.example
    assert json.loads(run(app, ["families", name, "--json"]).stdout) == case.model_dump()


def test_a_name_that_there_is_not_is_refused_with_those_there_are():
    result = run(app, ["families", "euler"])
    assert result.exit_code == 1
    assert "kowalewski" in result.stderr
