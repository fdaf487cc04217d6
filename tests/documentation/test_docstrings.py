"""Docstrings are understood at first reading: each begins with its subject, or is a noun.

"Error of a state, relative to its size" says what a number is; "Of a state, relative to its size" does not.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NO_SUBJECT = r"Of|By|From|Those|(At|For|In|Into|On|To|Up to|With) (which|whom|what|how)"
CLAUSES = rf"{NO_SUBJECT}|That|What|Who|Which"
ALL = rf"{CLAUSES}|Where|How"
REFUSED = {
    # Of an attribute a clause may say what it is: "Where the stretch begins", "How often the table is read".
    "service": (ALL, CLAUSES),
    "workers": (ALL, CLAUSES),
    "migrations": (ALL, CLAUSES),
    "docs": (ALL, CLAUSES),
    # A law may have a clause for its subject: "What is not finite passes no bound".
    "tests": (NO_SUBJECT, NO_SUBJECT),
}
"""Beginnings that are refused in a folder, and those of attributes there."""


def docstrings(tree: ast.Module) -> Iterator[tuple[bool, int, str]]:
    """Yield whether each docstring is that of an attribute, its line, and its text."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        for before, statement in zip([None, *body], body, strict=False):
            match statement:
                case ast.Expr(ast.Constant(str(text))):
                    is_attribute = isinstance(before, ast.Assign | ast.AnnAssign)
                    if is_attribute or before is None:
                        yield is_attribute, statement.lineno, text


def refused(text: str, beginnings: str, of_attributes: str) -> list[str]:
    """Return line and first line of the docstrings that begin with what is refused."""
    return [
        f"{line}: {doc.strip().splitlines()[0]}"
        for is_attribute, line, doc in docstrings(ast.parse(text))
        if re.match(rf"\W*({of_attributes if is_attribute else beginnings})\b", doc)
    ]


@pytest.mark.parametrize("folder", REFUSED)
def test_a_docstring_begins_with_its_subject_or_is_a_noun(folder: str):
    paths = sorted((ROOT / folder).rglob("*.py"))
    assert paths
    assert [
        f"{path.relative_to(ROOT)}:{found}"
        for path in paths
        for found in refused(path.read_text(), *REFUSED[folder])
    ] == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('"""What is read."""', 1),
        ('class C:\n    """Where rows are."""', 2),
        ('def f():\n    """How often it is asked."""', 2),
        ('async def f():\n    r"""\n    By its name.\n    """', 2),
        ('class C:\n    x: int = 0\n    """Of the error."""', 3),
        ('class C:\n    def __init__(self):\n        self.x = 0\n        """From 0 to 1."""', 4),
        ('X = 1\n"""That is allowed at most."""', 2),
        ('X = 1\n"""Up to which it is exact."""', 2),
    ],
)
def test_a_beginning_without_a_subject_is_found(text: str, line: int):
    assert [each.partition(":")[0] for each in refused(text, ALL, CLAUSES)] == [str(line)]


@pytest.mark.parametrize(
    "text",
    [
        '"""Offsets of rows."""',
        'X = 1\n"""How often it is asked."""',
        'class C:\n    """Rows."""\n\n    x: int = 0\n    """Where they begin."""',
        'x = "Of the error"\nf("By its name")',
    ],
)
def test_other_beginnings_and_other_strings_are_no_faults(text: str):
    assert refused(text, ALL, CLAUSES) == []
