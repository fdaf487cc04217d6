"""The tables as text for a terminal and for pages."""

import unicodedata
from collections.abc import Sequence
from pathlib import Path

from tests.benchmarks.measuring import Row, Table

ROOT = Path(__file__).parents[2]
REPORT, FRONT_PAGE = ROOT / "docs" / "performance.md", ROOT / "docs" / "index.md"
PICTURE = REPORT.with_suffix(".svg")
HEADS = ("target", "measured", "asked", "reached", "ours: time, error", "rival: time, error")


def section_of_rows(rows: Sequence[Row], circumstances: Sequence[str]) -> str:
    """Return the section of the targets in Markdown."""
    return _section("Targets", "", markdown(HEADS, [row.cells() for row in rows]), circumstances)


def section_of_tables(tables: Sequence[Table], circumstances: Sequence[str], picture: str = "") -> str:
    """Return the sections of one part in Markdown."""
    return "\n".join(
        _section(each.title, each.remark, markdown(each.heads, each.rows) + picture, circumstances)
        for each in tables
    )


def _section(title: str, remark: str, body: str, circumstances: Sequence[str]) -> str:
    told = f"{remark}\n\n" if remark else ""
    return f"## {title}\n\n{told}{body}\nMeasured: {'; '.join(circumstances)}.\n"


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


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _width(text: str) -> int:
    return sum(not unicodedata.combining(letter) for letter in text)
