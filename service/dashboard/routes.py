"""GET of each page and of its files: the same for everybody, so open where there are keys.

The files of a page have an address with a digest of all of them, so that browsers may cache them for ever.
"""

from collections.abc import Mapping
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

_TEXT = "text/html"
_DEEPEST = 30
"""Folders in an address beyond which its page is shown without styles."""
_KEEP = "public, max-age=31536000, immutable"


@dataclass(frozen=True)
class Page:
    """One page: its title, the module that fills it, what that imports, and where the navigation shows it."""

    title: str
    module: str
    imports: tuple[str, ...] = ()
    below: str = ""


PAGES = {
    "/": Page("Overview", "overview", ("arrays", "sphere", "follow", "sweeps", "planes")),
    "/workbench": Page("Workbench", "workbench", ("fields", "sphere", "verdict")),
    "/solutions": Page("Solutions", "lists", ("chosen", "follow")),
    "/jobs": Page("Jobs", "lists", ("chosen", "follow")),
    "/studies": Page("Studies", "lists", ("chosen", "follow")),
    "/sweeps": Page("Sweeps", "lists", ("chosen", "follow", "sweeps", "arrays", "planes")),
    "/families": Page("Families", "families", ("sphere", "starting", "follow")),
    "/accuracy": Page("Accuracy", "accuracy", ("chart",)),
    "/solution": Page("Solution", "solution", ("arrays", "sphere", "chart", "series", "body"), "/solutions"),
    "/study": Page("Study", "study", ("follow", "starting"), "/studies"),
    "/sweep": Page("Sweep", "sweep", ("arrays", "chart", "follow", "planes", "starting"), "/sweeps"),
}
"""The pages by their paths. These are flat: all links are relative, and hold behind a proxy's prefix, too."""
_MISSING = Page("Not found", "core")


@router.get("/")
@router.get("/workbench")
@router.get("/solutions")
@router.get("/jobs")
@router.get("/studies")
@router.get("/sweeps")
@router.get("/families")
@router.get("/accuracy")
@router.get("/solution")
@router.get("/study")
@router.get("/sweep")
async def show_shell(request: Request) -> Response:
    """Return a page without data: its module asks the API for them."""
    path = request.scope["route"].path
    return Response(_shell(PAGES[path], path), media_type="text/html", headers=HEADERS)


def wants_page(request: Request) -> bool:
    """Say whether a refused request comes from somebody who has opened an address that is none of the API."""
    is_api = request.url.path.startswith(("/v1/", "/static/", "/metrics"))
    return request.method in ("GET", "HEAD") and not is_api and _TEXT in request.headers.get("accept", "")


def show_missing(path: str, status: int, headers: Mapping[str, str]) -> Response:
    """Return the page that says that there is nothing at a path."""
    up = "../" * min(path.count("/") - 1, _DEEPEST)
    return Response(_shell(_MISSING, "", up), status, {**headers, **HEADERS}, _TEXT)


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
def _shell(page: Page, path: str, up: str = "") -> bytes:
    """Return the text of a page; ``up`` leads from the folder of its path to where all pages are."""
    template = _templates().get_template("missing.html" if page is _MISSING else f"{page.module}.html")
    text = template.render(page=page, path=path, pages=PAGES, up=up, static=f"{up}static/page/{digest()}")
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
