"""Blocks of code in the documentation are what they say: documents that are read, commands that exist.

Commands with curl are sent by ``tests/api/test_documentation.py``.
"""

import json
import re
import shlex
from pathlib import Path

import pytest
import typer
import yaml

from service.cli.commands import app

TOP = Path(__file__).parents[2]
PAGES = [TOP / "README.md", *sorted((TOP / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```", re.DOTALL | re.MULTILINE)
LEFT_OUT = "…"
"""Stands in a block for what is not shown."""


def blocks(language: str) -> list[tuple[str, str]]:
    return [
        (path.name, code)
        for path in PAGES
        for _, given, code in BLOCK.findall(path.read_text())
        if given == language
    ]


@pytest.mark.parametrize(("page", "code"), blocks("json"))
def test_a_document_is_json(page: str, code: str):
    if LEFT_OUT not in code:
        json.loads(code)


@pytest.mark.parametrize(("page", "code"), blocks("yaml"))
def test_a_recipe_is_yaml(page: str, code: str):
    assert all(isinstance(each, dict) for each in yaml.safe_load_all(code))


def commands() -> list[tuple[str, str]]:
    """Return each line of a shell block, and each quotation, that calls polhode."""
    lines = [
        (page, line.strip())
        for page, code in blocks("sh")
        for line in code.replace("\\\n", " ").splitlines()
        if re.match(r"\s*(\S*/)?polhode ", line)
    ]
    quoted = [
        (path.name, said)
        for path in PAGES
        for said in re.findall(r"`(polhode [a-z][^`]*)`", path.read_text())
    ]
    examples = [
        (f"{name} --help", line.strip())
        for name, command in typer.main.get_command(app).commands.items()
        for line in (command.epilog or "").splitlines()
        if line.strip().startswith("polhode ")
    ]
    return lines + quoted + examples


@pytest.mark.parametrize(("page", "line"), sorted(set(commands())))
def test_a_command_exists_with_its_options(page: str, line: str):
    # Brackets stand for what may be left out, a bar for a choice.
    words = shlex.split(re.sub(r"[\[\]|]", " ", line), comments=True)[1:]
    command, taken = typer.main.get_command(app), "polhode"
    while (children := getattr(command, "commands", None)) is not None and words:
        if (name := words.pop(0)) == "COMMAND":
            return
        assert name in children, f"{taken} has no command {name}"
        command, taken = children[name], f"{taken} {name}"
    known = {
        option
        for parameter in command.get_params(typer.Context(command))
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known
