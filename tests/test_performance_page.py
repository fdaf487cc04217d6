"""What make bench writes: a picture from the table beside it, each part in its place, nothing else."""

import xml.etree.ElementTree as ET

import pytest

from service.dynamics.accuracy import TIERS
from service.dynamics.numerics import NUMERICS
from service.storage.solutions.shipped_accuracy import shipped_costs
from tests.benchmarks import pages, precision
from tests.benchmarks.measuring import Result
from tests.benchmarks.parts import PARTS, accuracy_in_brief, costs_in_brief
from tests.benchmarks.report import FRONT_PAGE, REPORT, section_of_tables, text_of_table
from tests.benchmarks.whole import tiers


def test_the_page_has_points_of_every_way():
    found = precision.read(REPORT.read_text(encoding="utf-8"))
    assert {point.name for point in found[precision.COMPILED]} == {"draft", "standard", "high"}
    assert all(len(points) >= 3 for points in found.values())


def test_a_table_that_was_written_is_read_with_its_three_digits():
    points = [Result("draft", 9.4e-5, 1.7e-9), Result("1e-03", 35.5e-3, 8e-3), Result("high", 2.5, 1e-15)]
    table = precision.table({precision.COMPILED: points})
    rows = "\n".join("| " + " | ".join(row) + " |" for row in table.rows)
    found = precision.read(f"## {table.title}\n\n{rows}\n\n## Another\n| heyoka | x | 1 s | 1 |")
    assert [point.name for point in found[precision.COMPILED]] == ["draft", "1e-03", "high"]
    for point, written in zip(points, found[precision.COMPILED], strict=True):
        assert (written.seconds, written.error) == pytest.approx((point.seconds, point.error))
    assert found[precision.HEYOKA] == []
    assert table.title in text_of_table(table)


def test_the_same_numbers_make_the_same_picture(tmp_path):
    found = precision.read(REPORT.read_text(encoding="utf-8"))
    contents = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        precision.draw(found, tmp_path / folder / "picture.svg")
        contents.append((tmp_path / folder / "picture.svg").read_bytes())
    assert contents[0] == contents[1]
    assert ET.fromstring(contents[0]).tag.endswith("svg")


def test_every_part_has_its_place_in_the_page_and_in_their_order():
    page = REPORT.read_text(encoding="utf-8")
    assert all(pages.part_of(page, name) is not None for name in PARTS)
    places = [page.index(pages.BEGIN.format(name)) for name in PARTS]
    assert places == sorted(places)


def test_a_part_is_replaced_and_all_else_is_kept(tmp_path):
    path = tmp_path / "page.md"
    first, second = pages.framed("one", "old 1\n"), pages.framed("two", "old 2\n")
    before = f"first\n{first}between\n{second}last\n"
    path.write_text(before, encoding="utf-8")
    pages.write_part(path, "one", "new\nlines\n")
    assert path.read_text(encoding="utf-8") == before.replace("old 1\n", "new\nlines\n")
    with pytest.raises(pages.NoPlaceError, match="three"):
        pages.write_part(path, "three", "lost")


def test_the_costs_that_both_pages_show_are_those_that_are_shipped():
    costs = shipped_costs()
    assert costs.numerics == NUMERICS, "measure them anew: python -m tests.benchmarks tier-costs"
    table = tiers.table(costs)
    assert pages.part_of(FRONT_PAGE.read_text(encoding="utf-8"), "tier-costs") == costs_in_brief(table)
    page = pages.part_of(REPORT.read_text(encoding="utf-8"), "tier-costs") or ""
    assert page.startswith(section_of_tables([table], [""]).partition("\nMeasured")[0])
    for row in costs.rows:
        assert list(row.seconds) == list(TIERS)
        assert all(seconds > 0.0 for seconds in row.seconds.values())


def test_the_front_page_shows_every_tier_and_both_rivals():
    curves = {name: [Result(tier, 2e-3, 1e-9) for tier in TIERS[:3]] for name in (precision.JOB,)}
    curves |= {
        precision.SCIPY: [Result("1e-10", 0.2, 2e-9)],
        precision.HEYOKA: [Result("1e-16", 4e-4, 1e-14)],
    }
    brief = accuracy_in_brief(curves, Result("certified", 50e-3, 6e-33))
    shown = pages.part_of(FRONT_PAGE.read_text(encoding="utf-8"), "accuracy") or ""
    first, second = ([line.split("|")[1].strip() for line in text.splitlines()] for text in (brief, shown))
    assert first == second
    assert "| `certified` | a proven radius of 64, 128 or 333 bits | 6e-33, proven | 50 ms |" in brief
