"""Citations of solutions: BibTeX, Citation File Format 1.2.0 (https://citation-file-format.github.io)."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date

from service.schemas.reading.documents import Part

PAPER = "New solvable problems in the dynamics of a rigid body about a fixed point in a potential field"
"""Title of the paper by H. M. Yehia that the method is from."""
PROGRAM = "The polhode authors"
CITATIONS: Mapping[str, str] = {"bibtex": "application/x-bibtex", "cff": "application/yaml"}
"""Media types by the names of the formats."""

_SPECIAL = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
}


@dataclass(frozen=True, slots=True)
class Cited:
    """The facts that identify a solution to a reader."""

    id: str
    digest: str
    """SHA-256 of the problem and the numerics version."""
    title: str
    made: date
    version: str
    numerics: int


def title_of(problem: Part) -> str:
    """Return what the solution of a problem document is, in words, with its moments and its potential."""
    body, motion = problem["body"], problem["motion"]
    potential = problem["potential"]
    kinds = {"planar": "Planar motion", "state": "Motion from a given state"}
    kind = kinds.get(str(motion["type"])) or f"Classical motion ({motion.get('case')})"
    moments = ", ".join(f"{name} = {body[name]}" for name in ("A", "B", "C") if body.get(name) is not None)
    force = f"V = {formula}" if (formula := potential.get("expression")) else f"potential {potential['type']}"
    return f"{kind} of a rigid body about a fixed point, {moments}, {force}"


def bibtex(cited: Cited) -> str:
    """Return an entry for the solution, and one for the paper that the method is from."""
    solution = {
        "author": f"{{{PROGRAM}}}",
        "title": f"{{{_escaped(cited.title)}}}",
        "year": str(cited.made.year),
        "month": str(cited.made.month),
        "version": _escaped(cited.version),
        "note": f"Solution {cited.id}, computed with numerics {cited.numerics}; "
        f"SHA-256 of the problem {cited.digest}",
    }
    paper = {"author": "Yehia, Hamad M.", "title": f"{{{PAPER}}}", "note": "Manuscript"}
    return "\n".join(
        [*_entry(f"polhode-{cited.id}", solution), "", *_entry("yehia-new-solvable-problems", paper), ""]
    )


def _entry(key: str, fields: Mapping[str, str]) -> Iterator[str]:
    yield f"@misc{{{key},"
    yield from (f"  {name} = {{{value}}}," for name, value in fields.items())
    yield "}"


def _escaped(text: str) -> str:
    """Return text that TeX prints as it is, on one line."""
    return "".join(_SPECIAL.get(character, character) for character in " ".join(text.split()))


def cff(cited: Cited) -> str:
    """Return a citation file for the solution; every value is a JSON string, which YAML reads as text."""
    lines = [
        ("cff-version", "1.2.0"),
        ("message", "Please cite this solution as below."),
        ("type", "dataset"),
        ("title", cited.title),
        ("version", cited.version),
        ("date-released", cited.made.isoformat()),
    ]
    written = [f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in lines]
    written += ["authors:", f"  - name: {json.dumps(PROGRAM)}", "identifiers:"]
    written += _identifier(f"urn:uuid:{cited.id}", "The solution.")
    written += _identifier(f"sha256:{cited.digest}", f"The problem, with numerics {cited.numerics}.")
    written += ["references:", "  - type: article", f"    title: {json.dumps(PAPER)}", "    authors:"]
    return "\n".join([*written, '      - family-names: "Yehia"', '        given-names: "Hamad M."', ""])


def _identifier(value: str, description: str) -> Sequence[str]:
    return "  - type: other", f"    value: {json.dumps(value)}", f"    description: {json.dumps(description)}"
