"""Asks for examinations as the service does."""

from collections.abc import Sequence
from typing import Any

from service.schemas.problem.problem import check_problem
from service.storage.examinations import keys_of


def examination_of(documents: Sequence[object]) -> dict[str, Any]:
    """Return what :func:`service.verdicts.examination.examine_problems` takes, with nothing cached."""
    problems = []
    for document in documents:
        keys = keys_of(check_problem(document).canonical)
        problems.append({"document": document, "verdict": keys.verdict, "windows": keys.windows})
    return {"problems": problems, "cached": {}}
