"""The files of the page: our own, and plotly.js as its wheel ships it."""

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

OURS = Path(__file__).with_name("static")
_KINDS = {".css": "text/css", ".js": "text/javascript"}
_PLOTLY = "plotly.min.js"


@dataclass(frozen=True)
class StaticFile:
    """A file of the page: its bytes, its media type, its entity tag."""

    content: bytes
    media_type: str
    tag: str


@cache
def static_files() -> dict[str, StaticFile]:
    """Return all files of the page by their names."""
    found = {path.name: path.read_bytes() for path in sorted(OURS.iterdir()) if path.suffix in _KINDS}
    found[_PLOTLY] = files("plotly").joinpath("package_data", _PLOTLY).read_bytes()
    return {name: _described(name, content) for name, content in found.items()}


@cache
def digest() -> str:
    """Return the name of all files together: a part of their addresses, so that they can be kept for ever."""
    text = "\n".join(f"{name} {file.tag}" for name, file in static_files().items())
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _described(name: str, content: bytes) -> StaticFile:
    tag = hashlib.sha256(content).hexdigest()[:32]
    return StaticFile(content, _KINDS[Path(name).suffix], f'"{tag}"')
