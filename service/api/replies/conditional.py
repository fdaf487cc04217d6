"""Conditional requests (RFC 9110, 13; RFC 9111): strong entity tags, and what caches may keep."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from functools import cache

from fastapi import Request

from service.dynamics.numerics import NUMERICS
from service.versions import version_of

IMMUTABLE = "private, immutable, max-age=31536000"
"""Cache-Control of an answer that never changes: caches need not ask again for a year."""
REVALIDATE = "no-cache"
"""Cache-Control of an answer that may change: caches keep it, and ask each time whether it has changed."""
NO_STORE = "no-store"
"""Cache-Control of errors, and of answers that differ each time."""

VOLATILE = ("/livez", "/readyz", "/metrics", "/v1/status")
"""Paths whose answers are different each time: nobody should keep them, and they have no tags."""

REPRESENTATION = 1
"""Grows whenever the same resource is written differently and the version of the package stays."""
CODINGS = ("gzip", "zstd")
"""Content codings of answers; each makes another representation, whose tag ends in its name."""
_TAG_BYTES = 16
_TAGS = re.compile(r'\s*(?:W/)?("[\x21\x23-\x7e\x80-\xff]*")\s*(?:,|\Z)')
_CODED = re.compile(rf"-(?:{'|'.join(CODINGS)})\"\Z")


def tag_of_resource(request: Request, media_type: str, *identity: object) -> str:
    """Return the tag of an answer by what it is, known before the answer is made.

    Parameters
    ----------
    request
        Its path and query say what is asked for; the order of different parameters does not matter.
    identity
        What the stored resource is, and the version of everything in it that can change.
    """
    query = sorted(request.query_params.multi_items(), key=lambda pair: pair[0])
    return _tag(repr((_ours(), request.scope["path"], query, media_type, identity)).encode())


def tag_of_content(content: bytes) -> str:
    """Return the tag of an answer by its bytes."""
    return _tag(content)


def coded(tag: str, coding: str) -> str:
    """Return the tag of the same answer in a content coding: other bytes need another strong tag."""
    return f'{tag[:-1]}-{coding}"'


def matching_tag(header: str | None, tag: str) -> str | None:
    """Return the tag of an If-None-Match header that names the current answer, in any coding; else None.

    ``*`` names no tag: it matches whatever turns out to be there.
    """
    return next((each for each in _tags(header or "") if _CODED.sub('"', each) == tag), None)


def is_current(header: str | None, tag: str) -> bool:
    """Tell whether If-Match lets a change of what has this tag happen; without the header anything does.

    RFC 9110, 13.1.1: weak tags never match. A tag of any coding names the same state.
    """
    if header is None or header.strip() == "*":
        return True
    strong = (each[1] for each in _TAGS.finditer(header) if not each[0].lstrip().startswith("W/"))
    return any(_CODED.sub('"', each) == tag for each in strong)


def validators(tag: str, cache_control: str) -> Mapping[str, str]:
    """Return the headers by which a client can ask again."""
    return {"ETag": tag, "Cache-Control": cache_control}


def _tag(content: bytes) -> str:
    return f'"{hashlib.blake2b(content, digest_size=_TAG_BYTES).hexdigest()}"'


def _tags(header: str) -> Iterator[str]:
    """Yield the tags of a list; weak ones too, since If-None-Match compares weakly."""
    position = 0
    while found := _TAGS.match(header, position):
        yield found[1]
        position = found.end()


@cache
def _ours() -> tuple[object, ...]:
    return version_of("polhode"), REPRESENTATION, NUMERICS
