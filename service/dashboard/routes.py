"""GET of each page and of its files: the same for everybody, so open where there are keys."""

from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from typing import TYPE_CHECKING

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

from service.dashboard.files import digest, static_files
from service.dashboard.headers import HEADERS

if TYPE_CHECKING:
    from jinja2 import Environment

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
    "/solutions": Page("Solutions", "lists", ("query", "marks", "follow")),
    "/jobs": Page("Jobs", "lists", ("query", "marks", "follow")),
    "/sweeps": Page("Sweeps", "lists", ("query", "marks", "follow")),
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
