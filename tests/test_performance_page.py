"""The picture of docs/performance.md is drawn from the table that is beside it."""

import xml.etree.ElementTree as ET

import pytest

from tests.benchmarks import precision
from tests.benchmarks.measuring import Result
from tests.benchmarks.report import REPORT, text_of_table


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
