"""The tables as text for a terminal and for docs/performance.md."""

import unicodedata
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.measuring import Row, Table

REPORT = Path(__file__).parents[2] / "docs" / "performance.md"
PICTURE = REPORT.with_suffix(".svg")
HEADS = ("target", "measured", "asked", "reached", "ours: time, error", "rival: time, error")
HEAD = """\
# Speed against accuracy

Written by `make bench`: {circumstances}.

Everything was measured in one run on one machine: ratios count, not seconds. An error is the largest
absolute distance of any of the six variables (p, q, r, γ₁, γ₂, γ₃) from its certified enclosure at the very
same times, unless something else is said. Times are medians of warm calls that begin with the potential and
end with the samples, the structure of the problem being known; target 5 begins with the solution. They are
processor time, but by the clock where other processes or threads take part (targets 7, 8 and 10, the service,
whole requests, the tables of tiers). Integrators start from the exact state rounded to doubles. DOP853 is
`scipy.integrate.solve_ivp` with the equations in plain Python floats, for targets 1 and 9 at the loosest rtol
that reaches 1e-10, else at the one that comes closest; the compilation of heyoka is not counted.
"""


def document(rows: Sequence[Row], tables: Sequence[Table], circumstances: Sequence[str]) -> str:
    """Return the whole report in Markdown."""
    parts = [
        HEAD.format(circumstances="; ".join(circumstances)),
        "## Targets\n\n" + _markdown(HEADS, [row.cells() for row in rows]),
        f"![Error against time: kernels and whole jobs at each tier, DOP853, heyoka]({PICTURE.name})\n",
        *(f"## {table.title}\n\n{table.remark}\n\n{_markdown(table.heads, table.rows)}" for table in tables),
    ]
    return "\n".join(parts)


def text_of_rows(rows: Sequence[Row]) -> str:
    """Return one target a paragraph."""
    return "\n".join(
        f"{row.target}. {row.what}\n"
        f"   asked {row.asked}; reached {row.reached}{'' if row.is_reached else '  MISSED'}\n"
        f"   {row.ours}" + (f"\n   {row.rival}" if row.rival else "")
        for row in rows
    )


def text_of_table(table: Table) -> str:
    """Return a table in columns of even width."""
    lines = [table.heads, *table.rows]
    widths = [max(_width(line[k]) for line in lines) for k in range(len(table.heads))]
    text = [
        "  ".join(
            cell + " " * (width - _width(cell)) for cell, width in zip(line, widths, strict=True)
        ).rstrip()
        for line in lines
    ]
    return "\n".join([f"{table.title}. {table.remark}", *(f"  {line}" for line in text)])


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _width(text: str) -> int:
    return sum(not unicodedata.combining(letter) for letter in text)
