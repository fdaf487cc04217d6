"""GET of each page and of its files: the same for everybody, so open where there are keys.

The files of a page have an address with a digest of all of them, so that browsers may cache them for ever.
"""

from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from typing import TYPE_CHECKING

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

if TYPE_CHECKING:
    from jinja2 import Environment
import hashlib
from importlib.resources import files
from pathlib import Path

# Nothing from other hosts, no inline scripts or styles, no framing. Icons may be data: URLs, and pictures
# that are saved are painted from blob: URLs.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


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
    found = {path.name: path.read_bytes() for path in sorted(OURS.rglob("*")) if path.suffix in _KINDS}
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


router = APIRouter(include_in_schema=False)

_KEEP = "public, max-age=31536000, immutable"


@dataclass(frozen=True)
class Page:
    """One page: its title, the module that fills it, what that imports, and where the navigation shows it."""

    title: str
    module: str
    imports: tuple[str, ...] = ()
    below: str = ""


PAGES = {
    "/": Page("Overview", "overview", ("arrays", "sphere", "follow")),
    "/workbench": Page("Workbench", "workbench", ("fields", "sphere", "verdict")),
    "/solutions": Page("Solutions", "lists", ("query", "labels", "follow")),
    "/jobs": Page("Jobs", "lists", ("query", "labels", "follow")),
    "/sweeps": Page("Sweeps", "lists", ("query", "labels", "follow")),
    "/families": Page("Families", "families", ("sphere", "starting", "follow")),
    "/accuracy": Page("Accuracy", "accuracy", ("chart",)),
    "/solution": Page("Solution", "solution", ("arrays", "sphere", "chart", "series", "body"), "/solutions"),
    "/sweep": Page("Sweep", "sweep", ("arrays", "chart", "follow", "planes", "starting"), "/sweeps"),
}
"""The pages by their paths. These are flat: all links are relative, and hold behind a proxy's prefix, too."""


@router.get("/")
@router.get("/workbench")
@router.get("/solutions")
@router.get("/jobs")
@router.get("/sweeps")
@router.get("/families")
@router.get("/accuracy")
@router.get("/solution")
@router.get("/sweep")
async def show_shell(request: Request) -> Response:
    """Return a page without data: its module asks the API for them."""
    page = _shell(request.scope["route"].path)
    return Response(page, media_type="text/html", headers=HEADERS)


@router.get("/static/page/{version}/{name}")
async def show_file(version: str, name: str) -> Response:
    """Return a script, a style sheet or a picture; of the address that pages link to, for ever."""
    file = static_files().get(name)
    if file is None:
        raise HTTPException(HTTPStatus.NOT_FOUND)
    headers = {**HEADERS, "ETag": file.tag}
    if version == digest():
        headers["Cache-Control"] = _KEEP
    return Response(file.content, media_type=file.media_type, headers=headers)


@cache
def _shell(path: str) -> bytes:
    page = PAGES[path]
    template = _templates().get_template(f"{page.module}.html")
    text = template.render(page=page, path=path, pages=PAGES, static=f"static/page/{digest()}")
    return text.encode()


@cache
def _templates() -> "Environment":
    # Not at the top: a service is there earlier without it.
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415

    return Environment(
        loader=PackageLoader("service.dashboard"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
