"""The answers whose tag is known before they are made: of what each is made, and 304 before all else.

A tag is made of what is stored, the path, the query and the media type. A client that
sends the tag of the present answer was given that answer to the very same question. So
its query is not read again and its endpoint is not asked: 304 needs one row, which is
mostly cached. Any other request goes on to the endpoint, which answers or refuses it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import (  # Any: what a row of the table reads; names of formats, which are literals
    Any,
    Generic,
    TypeVar,
)

from fastapi import Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Resources
from service.api.formats.lists import FORMATS
from service.api.formats.negotiation import ARROW, JSON, MEDIA_TYPES, NPZ, preferred
from service.api.formats.origins import CITATIONS
from service.api.formats.points import ZIP
from service.api.replies import IMMUTABLE, REVALIDATE, ApiError, matching_tag, tag_of_resource, validators
from service.jobs.records import ResultNotFoundError, SolutionNotFoundError, SweepNotFoundError
from service.schemas.reading.documents import Annotation
from service.storage.database.cached_reads import Read
from service.storage.solutions.result_store import known_atlas, known_study
from service.storage.solutions.solution_store import SolutionStanding, standing_and_annotation, standing_of
from service.storage.sweeps.sweep_store import SweepStanding, sweep_standing_of

Standing = TypeVar("Standing")


@dataclass(frozen=True, slots=True)
class Tagged(Generic[Standing]):
    """The functions that give the tag of an answer before the answer is made."""

    read: Read[Standing]
    """Reads what is stored, without documents and arrays."""
    identity: Callable[[Standing], tuple[object, ...]]
    """Returns all that the bytes of the answer depend on."""
    cache_control: Callable[[Standing], str]
    """Returns its Cache-Control."""
    formats: Mapping[Any, str]
    """Media types by the parameter ``format``, where there is that; a single one is not negotiated."""

    @property
    def varies(self) -> Mapping[str, str]:
        """The header that says on what the answer depends beside its address."""
        return {"Vary": "Accept"} if len(self.formats) > 1 else {}

    def media_type(self, request: Request) -> str | None:
        """Return the media type of the answer; None if the endpoint would refuse to choose."""
        if len(self.formats) == 1:
            return next(iter(self.formats.values()))
        asked = request.query_params.getlist("format")
        if asked:
            return self.formats.get(asked[0])
        try:
            return preferred(tuple(self.formats.values()), request.headers.get("accept"))
        except ApiError:
            return None


def _as_it_is(standing: object) -> tuple[object, ...]:
    return (standing,)


def _solved(standing: SolutionStanding) -> tuple[object, ...]:
    return standing.id, standing.digest


def _annotated(found: tuple[SolutionStanding, Annotation]) -> tuple[object, ...]:
    return (*_solved(found[0]), found[1])


def _computed(standing: SweepStanding) -> tuple[object, ...]:
    return standing.id, standing.done, standing.refused, standing.way


def _for_ever(_: object) -> str:
    return IMMUTABLE


def _for_now(_: object) -> str:
    return REVALIDATE


def _till_the_end(standing: SweepStanding) -> str:
    return IMMUTABLE if standing.is_finished else REVALIDATE


_JSON = {"json": JSON}
TAGGED: Mapping[str, Tagged[Any]] = {
    "/v1/solutions/{solution_id}": Tagged(standing_and_annotation, _annotated, _for_now, _JSON),
    "/v1/solutions/{solution_id}/trajectory": Tagged(standing_of, _as_it_is, _for_ever, MEDIA_TYPES),
    "/v1/solutions/{solution_id}/function": Tagged(standing_of, _as_it_is, _for_ever, _JSON),
    "/v1/solutions/{solution_id}/enclosures": Tagged(standing_of, _as_it_is, _for_ever, _JSON),
    "/v1/solutions/{solution_id}/citation": Tagged(standing_of, _solved, _for_ever, CITATIONS),
    "/v1/solutions/{solution_id}/provenance": Tagged(standing_of, _solved, _for_now, _JSON),
    "/v1/atlases/{atlas_id}": Tagged(known_atlas, _as_it_is, _for_ever, {name: name for name in FORMATS}),
    "/v1/jobs/{job_id}/result": Tagged(known_study, _as_it_is, _for_ever, _JSON),
    "/v1/sweeps/{sweep_id}/points": Tagged(sweep_standing_of, _computed, _till_the_end, MEDIA_TYPES),
    "/v1/sweeps/{sweep_id}/grid": Tagged(
        sweep_standing_of, _computed, _till_the_end, {"json": JSON, "arrow": ARROW, "npz": NPZ}
    ),
    "/v1/sweeps/{sweep_id}/package": Tagged(sweep_standing_of, _computed, _for_ever, {"zip": ZIP}),
}
"""The answers with such a tag, by the templates of their paths, which have one parameter: the id."""


async def unchanged(request: Request, tagged: Tagged[Any]) -> Response | None:
    """Return 304 if the client sends the tag of the present answer; None if the endpoint is to be asked."""
    header = request.headers.get("if-none-match")
    # "*" names no tag: whether there is anything at all, is known when the answer has been made.
    if header is None or header.strip() == "*":
        return None
    media_type = tagged.media_type(request)
    if media_type is None:
        return None
    resources: Resources = request.app.state.resources
    resource_id = _id_in(request)
    standing = resources.reads.cached(tagged.read, resource_id)
    if standing is None:
        try:
            standing = await run_in_threadpool(resources.reads.get, tagged.read, resource_id)
        except (ResultNotFoundError, SolutionNotFoundError, SweepNotFoundError):
            return None  # the endpoint says so, after all that is wrong with the query
    known = matching_tag(header, tag_of_resource(request, media_type, *tagged.identity(standing)))
    if known is None:
        return None
    headers = {**validators(known, tagged.cache_control(standing)), **tagged.varies}
    return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)


def validator_headers(request: Request, inside: Resources, standing: object = None) -> dict[str, str]:
    """Return the headers of an answer of the table by which a client can ask again.

    Parameters
    ----------
    standing
        What the table reads for it, if the endpoint has read it already.

    Raises
    ------
    ResultNotFoundError, SolutionNotFoundError, SweepNotFoundError
        There is nothing of that id.
    """
    tagged = TAGGED[request.scope["route"].path]
    media_type = tagged.media_type(request)
    assert media_type is not None  # the endpoint has chosen one, too
    if standing is None:
        standing = inside.reads.get(tagged.read, _id_in(request))
    tag = tag_of_resource(request, media_type, *tagged.identity(standing))
    return {**validators(tag, tagged.cache_control(standing)), **tagged.varies}


def solution_tag(request: Request, standing: SolutionStanding, annotation: Annotation) -> str:
    """Return the tag of a solution's summary, in which nothing but its annotation can change."""
    return tag_of_resource(request, JSON, *_annotated((standing, annotation)))


def _id_in(request: Request) -> str:
    (resource_id,) = request.path_params.values()
    return str(resource_id)
