"""``python -m workers atlas FILE``: draws an atlas, in child processes that can be killed."""

import json
from pathlib import Path

from rich.console import Console

from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.atlas.reading import read_atlas
from service.schemas.atlas.replies import AtlasOut
from service.schemas.atlas.showing import describe_atlas, picture_of
from service.schemas.replies.verdict_text import Refusal
from service.settings import Settings, read_settings
from service.terminal import STANDARD_STREAM, OutputFile, answer, check_writable, read_document, say
from service.verdicts.atlases import examine_atlas
from service.verdicts.refusals import refusal_of_reading
from workers.computation.atlases import with_stability

_REFUSED, _WRONG_USAGE = 1, 2


def draw_file(file: Path, *, as_json: bool, picture: Path | None) -> int:
    """Print the atlas that the document of a file asks for; return 1 if it is refused."""
    if picture == STANDARD_STREAM and as_json:
        say("--json and --picture=- both write to stdout; accepted is one of them")
        return _WRONG_USAGE
    if picture is not None:
        check_writable(picture)
    settings = read_settings()
    document = read_document(file)
    error = refusal_of_reading(document, read_atlas)
    found = {"error": error} if error is not None else _drawn(document, settings)
    if isinstance(found, str):
        say(found)
        return _REFUSED
    if "error" in found:
        if as_json:
            answer(json.dumps(found["error"]) + "\n")
        say(Refusal.model_validate(found["error"]).reason())
        return _REFUSED
    drawn = AtlasOut.model_validate(found["verdict"])
    if picture is not None:
        with OutputFile(picture) as out:
            out.write(picture_of(drawn).encode())
    if picture != STANDARD_STREAM:
        answer(json.dumps(found["verdict"]) + "\n" if as_json else describe_atlas(drawn) + "\n")
    return 0


def _drawn(document: object, settings: Settings) -> dict[str, object] | str:
    """Return the atlas or its refusal, or for people why there is neither."""
    asked = json.dumps(document)
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[with_stability.__module__])
    limit = f"POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}"
    try:
        with Console(stderr=True).status("drawing …"):  # shows nothing where stderr is not a terminal
            found = sandbox.run(examine_atlas, asked, seconds=settings.verdict_seconds)
            if read_atlas(document).wants_stability:
                limit = f"POLHODE_JOB_SECONDS = {settings.job_seconds:g}"
                found = sandbox.run(with_stability, asked, found, seconds=settings.job_seconds)
    except SandboxTimeoutError:
        return f"no atlas within {limit}"
    except SandboxMemoryError:
        return f"no atlas within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}"
    except SandboxCrashError as fault:
        return f"no atlas: {fault}"
    finally:
        sandbox.close()
    read: dict[str, object] = json.loads(found)
    return read
