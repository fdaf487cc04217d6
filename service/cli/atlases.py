"""Draws an atlas for ``polhode atlas``, in a child process that can be killed."""

import json
from pathlib import Path

from service.cli.children import examining
from service.cli.common import REFUSED, WRONG_USAGE, fail, settings_of
from service.schemas.atlas.picture import picture_of
from service.schemas.atlas.reading import read_atlas
from service.schemas.atlas.replies import AtlasOut
from service.schemas.atlas.text import describe_atlas
from service.schemas.replies.verdict_text import Refusal
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document
from service.verdicts.atlases import examine_atlas
from service.verdicts.refusals import refusal_of_reading


def draw_file(file: Path, *, as_json: bool, picture: Path | None) -> None:
    """Print the atlas that the document of a file asks for, and exit with 1 if it is refused."""
    if picture == STANDARD_STREAM and as_json:
        fail("--json and --picture=- both write to stdout; accepted is one of them", WRONG_USAGE)
    if picture is not None:
        check_writable(picture)
    document = read_document(file)
    error = refusal_of_reading(document, read_atlas)
    found = {"error": error} if error is not None else json.loads(_drawn(document))
    if "error" in found:
        if as_json:
            answer(json.dumps(found["error"]) + "\n")
        fail(Refusal.model_validate(found["error"]).reason(), REFUSED)
    drawn = AtlasOut.model_validate(found["verdict"])
    if picture is not None:
        with OutputFile(picture) as out:
            out.write(picture_of(drawn).encode())
    if picture == STANDARD_STREAM:
        return
    if as_json:
        answer(json.dumps(found["verdict"]) + "\n")
    else:
        answer(describe_atlas(drawn) + "\n")


def _drawn(document: object) -> str:
    settings = settings_of()
    with examining(settings, examine_atlas.__module__) as sandbox:
        return sandbox.run(examine_atlas, json.dumps(document), seconds=settings.verdict_seconds)
