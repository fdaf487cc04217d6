"""Notebooks: stored without outputs, all of them in the menu; what they print and draw is shown.

``make docs`` executes the tutorials themselves.
"""

import base64
import json
import sys
from pathlib import Path

import nbformat
import pytest
import yaml
from nbclient.exceptions import CellExecutionError
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

TOP = Path(__file__).parents[2]
NOTEBOOKS = sorted((TOP / "docs" / "tutorials").glob("*.ipynb"))
PICTURE = base64.b64encode(b"not really a picture").decode()


@pytest.fixture(scope="module")
def notebooks():
    """The module of the documentation that makes pages of notebooks; hooks of MkDocs are no package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOP / "docs" / "site"))
        import notebooks as module  # noqa: PLC0415

        yield module
    del sys.modules["notebooks"]


def pages_of(entry: object) -> list[str]:
    if isinstance(entry, str):
        return [entry]
    return [
        page for part in (entry.values() if isinstance(entry, dict) else entry) for page in pages_of(part)
    ]


def test_every_notebook_is_in_the_menu():
    menu = (TOP / "docs" / "site" / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    listed = [page for page in pages_of(yaml.safe_load(menu)) if page.startswith("tutorials/")]
    assert len(NOTEBOOKS) == 8
    assert sorted(listed) == [f"tutorials/{path.stem}.md" for path in NOTEBOOKS]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_stored_notebook_has_sources_alone(path):
    notebook = json.loads(path.read_text())
    nbformat.validate(notebook)
    assert set(notebook["metadata"]) == {"kernelspec"}
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert 5 <= len(code) <= 15
    for cell in code:
        assert (cell["outputs"], cell["execution_count"], cell["metadata"]) == ([], None, {})
    sources = ["".join(cell["source"]) for cell in notebook["cells"]]
    assert sources[0].startswith("# ")
    assert any("ph.local()" in source for source in sources)
    assert not any("/home/" in source or "/tmp" in source for source in sources)


def test_outputs_are_shown_below_their_cells(notebooks):
    outputs = [
        new_output("stream", name="stdout", text="printed\n"),
        new_output("stream", name="stderr", text="\r███ 50%"),
        new_output("execute_result", data={"text/plain": "<Axes>", "image/png": PICTURE}),
        new_output("execute_result", data={"text/plain": "frame", "text/html": "<table>\n\n</table>"}),
    ]
    cells = [new_markdown_cell("# On [to the next](other.ipynb)"), new_code_cell("1 + 1", outputs=outputs)]
    page = notebooks.page_of(new_notebook(cells=cells), "name")
    head, code, printed, picture, table, source = page.markdown.strip().split("\n\n")
    assert (head, code) == ("# On [to the next](other.md)", "```python\n1 + 1\n```")
    assert printed == "```{.text .output}\nprinted\n```"
    assert (picture, page.pictures) == (
        "![What the cell above draws](name-1.png)",
        {"name-1.png": b"not really a picture"},
    )
    assert table == '<div class="output"><table>\n</table></div>'
    assert "name.ipynb" in source


@pytest.mark.long  # a kernel starts three times
def test_errors_and_warnings_end_the_build(notebooks):
    def executed(code: str):
        return notebooks.executed(new_notebook(cells=[new_code_cell(code)]))

    assert executed("print(6 * 7)").cells[0].outputs[0]["text"] == "42\n"
    with pytest.raises(notebooks.WarnedError, match="beware"):
        executed("import warnings; warnings.warn('beware')")
    with pytest.raises(CellExecutionError, match="ZeroDivisionError"):
        executed("1 / 0")
