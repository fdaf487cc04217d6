"""Pictures leave the page: each chart, sphere, atlas and body as a file that a printer or a film needs."""

import itertools
import json
import re
import zlib
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.support.browser import address, problem, settle

SVG = "{http://www.w3.org/2000/svg}"
CHANGES_OF_COLOUR = 0.02
"""Share of the pixels that differ a quarter of a film later: the edges of the body alone are more."""
COLUMN, PAGE = 90, 180
"""Millimetres: one column and both columns of a journal."""
DPI = 600


def save(page: Page, place: str, kind: str, folder: Path) -> Path:
    figure = page.locator(f".figure:has(> #{place}), .figure:has(> .heat #{place})")
    figure.locator("summary[data-export]").click()
    with page.expect_download() as download:
        figure.locator(f"button[data-export={kind}]").click()
    path = folder / f"{place}.{kind}"
    download.value.save_as(path)
    assert download.value.suggested_filename.endswith(f"{place}.{kind}")
    expect(figure.locator("details")).not_to_have_attribute("open", "")
    return path


def millimetres(text: str | None) -> float:
    return float((text or "").removesuffix("mm"))


def pixels_of_pdf(path: Path) -> np.ndarray:
    """Return what is packed in the one picture of a page."""
    content = path.read_bytes()
    start = int(re.search(rb"startxref\n(\d+)", content)[1])
    assert content[start : start + 4] == b"xref"
    rows = re.findall(rb"(\d{10}) 00000 n", content[start:])
    assert all(content[int(place) :].startswith(b"%d 0 obj" % k) for k, place in enumerate(rows, start=1))
    head = re.search(rb"/Width (\d+) /Height (\d+) .*? /Length (\d+) >>\nstream\n", content)
    packed = content[head.end() : head.end() + int(head[3])]
    return np.frombuffer(zlib.decompress(packed), np.uint8).reshape(int(head[2]), int(head[1]), 3)


def test_charts_and_spheres_are_saved_for_print(tab, tmp_path):
    tab.page.emulate_media(color_scheme="dark")
    page = tab.open(address("/solution", tab.site))
    settle(page)
    for place, width in (("series", PAGE), ("gamma", COLUMN), ("multipliers", COLUMN)):
        root = ElementTree.parse(save(page, place, "svg", tmp_path)).getroot()
        # Sizes are whole pixels of a 96th of an inch, 0.26 mm.
        assert millimetres(root.get("width")) == pytest.approx(width, abs=0.14)
        texts = {"".join(found.itertext()) for found in root.iter(f"{SVG}text")}
        assert {"series": {"t", "ω", "γ", "γ₃"}, "gamma": {"γ₁", "γ₂", "γ₃"}, "multipliers": {"1", "i"}}[
            place
        ] <= texts
        with Image.open(save(page, place, "png", tmp_path)) as picture:
            assert picture.info["dpi"] == pytest.approx(
                (DPI, DPI), abs=0.01
            )  # pixels a metre are whole numbers
            assert picture.width == pytest.approx(width / 25.4 * DPI, abs=4)
            pixels = np.asarray(picture.convert("RGB"))
        # Light whatever the theme is, and not empty: most is paper.
        assert tuple(pixels[0, 0]) == (255, 255, 255)
        assert 0.5 < np.mean(np.all(pixels == 255, axis=-1)) < 0.999
        assert np.array_equal(pixels_of_pdf(save(page, place, "pdf", tmp_path)), pixels)
    # What the caption proves is what is drawn: all points of a line, not those that a library leaves.
    points = page.evaluate("document.getElementById('series').data.find(({name}) => name === 'γ₁').x.length")
    line = page.locator("#series .scatterlayer path.js-line").first.get_attribute("d")
    assert len(re.findall(r"[ML]", line)) == points


def test_an_atlas_and_a_heat_map_are_saved_with_what_is_painted(tab, tmp_path):
    page = tab.open("workbench#" + quote(json.dumps(problem("first"))))
    settle(page)
    page.locator("#atlas .scatterlayer path").first.wait_for()
    root = ElementTree.parse(save(page, "atlas", "svg", tmp_path)).getroot()
    assert {"λ", "γ₁"} <= {"".join(found.itertext()) for found in root.iter(f"{SVG}text")}
    page = tab.open(f"sweep?id={tab.site.sweep}")
    settle(page)
    expect(page.locator("#picture-note")).not_to_be_empty()
    root = ElementTree.parse(save(page, "picture", "svg", tmp_path)).getroot()
    assert any("data:image/png" in str(found.attrib) for found in root.iter(f"{SVG}image"))


@pytest.mark.long
def test_the_turning_body_is_a_film(tab, tmp_path):
    page = tab.open(address("/solution", tab.site))
    settle(page)
    page.get_by_label("Speed").select_option("4")  # a film of two seconds
    with Image.open(save(page, "turning", "gif", tmp_path)) as film:
        assert (film.n_frames, film.info["duration"]) == (50, 40)
        frames = []
        for k in (0, 12, 25):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")))
    for first, second in itertools.pairwise(frames):
        assert np.mean(np.any(first != second, axis=-1)) > CHANGES_OF_COLOUR
    content = save(page, "turning", "webm", tmp_path).read_bytes()
    assert content[:4] == b"\x1a\x45\xdf\xa3"  # EBML
    # Blocks of pictures (SimpleBlock, 0xA3) of one cluster or more (0x1F43B675).
    assert content.count(b"\x1f\x43\xb6\x75") >= 1
    assert content.count(b"\xa3") > 10
