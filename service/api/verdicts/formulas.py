"""Asks children for the formulas of a verdict, simplified as far as there is time."""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress

from service.api.replies.errors import ApiError
from service.api.verdicts.children import examine
from service.api.verdicts.verdict_queue import Claimant, VerdictQueue
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.typesetting.equations import Format
from service.verdicts.formulas import examine_question_with_formulas, simplify_formula, with_simplified


async def examine_with_formulas(
    verdicts: VerdictQueue,
    document: Mapping[str, object],
    formats: Sequence[Format],
    claimant: Claimant,
    *,
    seconds: float,
) -> Mapping[str, object] | None:
    """Return the verdict with its formulas, which are simplified for ``seconds`` at most; raises as examine.

    A formula for which SymPy takes too long or too much memory stays as it is, and so does one for which the
    queue has no place.
    """
    asked = json.dumps({"document": document, "formats": formats})
    verdict = await examine(verdicts, examine_question_with_formulas, asked, claimant)
    if verdict is None:
        return None
    works = verdict["works"]
    assert isinstance(works, list)
    answers: list[str] = []
    deadline = time.monotonic() + seconds
    for work in works:
        rest = deadline - time.monotonic()
        if rest <= 0:
            break
        with suppress(ApiError, SandboxTimeoutError, SandboxMemoryError, SandboxCrashError):
            answers.append(await verdicts.ask(simplify_formula, work, claimant, crashes=0, seconds=rest))
    return with_simplified(verdict, answers)
