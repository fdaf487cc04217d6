"""The tutorials: notebooks that are executed, and shown as pages with what they print and draw.

Stored notebooks hold no outputs. ``make docs`` executes them, each in a folder of its own that is deleted
afterwards; an error or a warning in any cell ends the build. Other builds show the cells alone.
"""

import base64
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

CELL_SECONDS = 300
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
LINK = re.compile(r"\]\(([\w-]+)\.ipynb\)")


class WarnedError(Exception):
    """A cell of a notebook warned."""


@dataclass(frozen=True)
class Tutorial:
    """A notebook as a page: its Markdown, and its pictures by their names."""

    markdown: str
    pictures: dict[str, bytes]


def executed(notebook: NotebookNode) -> NotebookNode:
    """Return a notebook with its outputs.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        A cell failed.
    WarnedError
        A cell warned.
    """
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        # The kernel would warn that it hears on a port of this machine; its messages are signed.
        quiet = ["--log-level=ERROR"]
        client = NotebookClient(
            notebook, timeout=CELL_SECONDS, resources=resources, extra_arguments=quiet, kernel_name="python3"
        )
        client.execute()
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr" and "Warning" in output["text"]:
                raise WarnedError(f"{output['text']}\nin the cell\n{cell.source}")
    return notebook


def tutorial(path: Path, *, is_executed: bool) -> Tutorial:
    """Return the page of the notebook in a file."""
    notebook = nbformat.read(path, as_version=4)
    return page_of(executed(notebook) if is_executed else notebook, path.stem)


def page_of(notebook: NotebookNode, name: str) -> Tutorial:
    """Return a notebook as a page; ``name`` begins the names of its pictures."""
    pictures: dict[str, bytes] = {}
    parts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(LINK.sub(r"](\1.md)", cell.source))
            continue
        parts.append(f"```python\n{cell.source}\n```")
        parts += _outputs(cell, name, pictures)
    parts.append(f"This page is a notebook: [download it]({name}.ipynb).")
    return Tutorial("\n\n".join(parts) + "\n", pictures)


def _outputs(cell: NotebookNode, name: str, pictures: dict[str, bytes]) -> Iterator[str]:
    for output in cell.outputs:
        data = output.get("data", {})
        if "image/png" in data:
            file = f"{name}-{len(pictures) + 1}.png"
            pictures[file] = base64.b64decode(data["image/png"])
            yield f"![What the cell above draws]({file})"
        elif "text/html" in data:
            # Blank lines would end the block of HTML.
            html = re.sub(r"\n\s*\n", "\n", data["text/html"])
            yield f'<div class="output">{html}</div>'
        elif text := _text(output, data):
            yield f"```{{.text .output}}\n{text}\n```"


def _text(output: NotebookNode, data: NotebookNode) -> str:
    """Return what a cell printed or is; bars of progress, which go to stderr, are nothing on a page."""
    printed = output.get("text", "") if output.get("name") == "stdout" else ""
    return COLOURS.sub("", printed or data.get("text/plain", "")).rstrip()
