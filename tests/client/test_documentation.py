"""The Python of the documentation runs as printed, block after block, against a service."""

import re
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]


@pytest.mark.parametrize(("name", "least"), [("README.md", 1), ("docs/client.md", 5)])
def test_the_code_of_a_page_runs(connected, name, least, tmp_path, monkeypatch):
    blocks = re.findall(r"^```python\n(.*?)^```", (TOP / name).read_text(encoding="utf-8"), re.M | re.S)
    assert len(blocks) >= least
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
    names["c"].close()
    assert names["m"].error <= 1e-12
