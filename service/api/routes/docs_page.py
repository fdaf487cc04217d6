"""GET /docs: the interactive documentation of the API (Swagger UI), with every file it needs."""

from functools import cache
from importlib.resources import files
from pathlib import Path

from fastapi import APIRouter, Response

from service.api.queries.queries import without_query
from service.api.replies.responses import tag_of_content
from service.dashboard.routes import HEADERS

router = APIRouter(prefix="/docs", include_in_schema=False)

OURS = Path(__file__).with_name("page")
SWAGGER_UI = "fastapi_swagger.resources"
"""The package that ships the files of Swagger UI."""

_HEADERS = {**HEADERS, "Cache-Control": "public, max-age=3600"}


@router.api_route("", methods=["GET", "HEAD"], dependencies=[without_query])
async def show_page() -> Response:
    """Return the page."""
    return _answer(_ours("docs.html"), "text/html")


@router.api_route("/start.js", methods=["GET", "HEAD"], dependencies=[without_query])
async def show_start() -> Response:
    """Return the script that fills the page."""
    return _answer(_ours("start.js"), "text/javascript")


@router.api_route("/swagger-ui-bundle.js", methods=["GET", "HEAD"], dependencies=[without_query])
async def show_script() -> Response:
    """Return the JavaScript of Swagger UI."""
    return _answer(_shipped("swagger-ui-bundle.js"), "text/javascript")


@router.api_route("/swagger-ui.css", methods=["GET", "HEAD"], dependencies=[without_query])
async def show_style() -> Response:
    """Return the style sheet of Swagger UI."""
    return _answer(_shipped("swagger-ui.css"), "text/css")


@router.api_route("/favicon-32x32.png", methods=["GET", "HEAD"], dependencies=[without_query])
async def show_icon() -> Response:
    """Return the icon of the page."""
    return _answer(_shipped("favicon-32x32.png"), "image/png")


def _answer(content: bytes, media_type: str) -> Response:
    return Response(content, media_type=media_type, headers={**_HEADERS, "ETag": _tag(content)})


@cache
def _tag(content: bytes) -> str:
    return tag_of_content(content)


@cache
def _ours(name: str) -> bytes:
    return (OURS / name).read_bytes()


@cache
def _shipped(name: str) -> bytes:
    return files(SWAGGER_UI).joinpath(name).read_bytes()
