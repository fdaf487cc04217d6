"""The canonical form of a problem document, as jobs are stored under it."""

from service.schemas.problem.problem import check_problem


def canonical_document(document: object) -> dict[str, object]:
    """Return the canonical form; raises as :func:`check_problem`."""
    return check_problem(document).canonical
