"""Every place of the paper with its verdict.

``python -m tests.paper.catalogue > docs/paper.md`` writes it down.
"""

import ast
import sys
from functools import cache
from pathlib import Path

from tests.paper.places import section_1, section_2, section_3, section_4, section_5
from tests.paper.record import Record

FOLDER = Path(__file__).parent
DOCUMENT = FOLDER.parents[1] / "docs" / "paper.md"

SECTIONS = (
    ("1. Introduction", section_1.RECORDS),
    ("2. A new solvable case", section_2.RECORDS),
    ("3. The general form of the solution", section_3.RECORDS),
    ("4. Generalization of the classical Bobylev-Steklov, Chaplygin and Goriatchev cases", section_4.RECORDS),
    ("5. Some closed-form and polynomial potentials", section_5.RECORDS),
)
CATALOGUE: tuple[Record, ...] = tuple(record for _, records in SECTIONS for record in records)

INTRODUCTION = r"""# The paper, formula by formula

H. M. Yehia, *New solvable problems in the dynamics of a rigid body about a fixed point in a potential field*,
Department of Mathematics, Faculty of Science, Mansoura University, Mansoura 35516, Egypt.

Every numbered equation and every display of the paper, in its order, with the tests that verify it or show
that it must read otherwise: {verified} entries are verified as printed, {erratum} are errata, each shown by a
computation, and {remark} are remarks. Where the service has the formula, its code is held
against the printed one. Identities are proved in exact arithmetic, $\alpha$ a symbol wherever it can be one;
motions are compared in balls of 160 bits, integrals with 45 digits. Misprints of words ("asd" after (9),
"denomenator") are left out.

Places are named by the labels of the TeX source; *no.* is the number as typeset. Notation:

$$\alpha = \frac AC, \quad V_i = \frac{{\partial V}}{{\partial\gamma_i}}, \quad
D = \gamma_1 V_3 - \gamma_3 V_1, \quad Q = A\gamma_1^2 + C\gamma_3^2, \quad \rho = \gamma_1^2 + \gamma_3^2,$$

$$w = \lvert A-C\rvert^{{\alpha-1}} \frac{{\lvert\gamma_3\rvert^{{2\alpha}}}}{{\gamma_1^2}}, \quad
H[V] = V + \frac{{Q D}}{{2(A-C)\gamma_1\gamma_3}}, \quad
\nu = \frac{{\gamma_3^2}}{{\gamma_1}} \text{{ for }} A = 2C.$$

Equation (e), $L(V) = 0$, says that $H[V]$ is constant on every curve $\lvert\gamma_3\rvert = \lambda
\lvert\gamma_1\rvert^{{C/A}}$, that is, a function of $w$; the constant is the energy of the motion there.

This file is written by `python -m tests.paper.catalogue > docs/paper.md`; a test keeps it, the catalogue and
the tests in step.
"""

VERDICTS = {"verified": "as printed", "erratum": "**erratum**", "remark": "remark"}


@cache
def files_of_tests() -> dict[str, str]:
    """Return the file of every test function of this folder that is about the paper."""
    found = {}
    for path in sorted(FOLDER.glob("test_[1-5]_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                found[node.name] = path.name
    return found


def render() -> str:
    """Return docs/paper.md."""
    counts = {
        status: sum(record.status == status for record in CATALOGUE)
        for status in ("verified", "erratum", "remark")
    }
    parts = [INTRODUCTION.format(**counts)]
    for title, records in SECTIONS:
        rows = [
            f"## {title}",
            "",
            "| place | no. | printed | correct | proof |",
            "| --- | --- | --- | --- | --- |",
        ]
        parts.append("\n".join([*rows, *(_row(record) for record in records)]) + "\n")
    return "\n".join(parts)


def _row(record: Record) -> str:
    number = "" if record.number is None else str(record.number)
    correct = VERDICTS[record.status] + (f": {record.correct}" if record.correct else "")
    proof = "<br>".join(f"[{name}](../tests/paper/{files_of_tests()[name]})" for name in record.proof)
    return f"| {record.place} | {number} | {record.printed} | {correct} | {proof} |"


if __name__ == "__main__":
    sys.stdout.write(render())
