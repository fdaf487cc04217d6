"""The document that asks for an audit: how a stored solution's problem is solved again."""

from pydantic import Field

from service.schemas.problem.sections import Method
from service.schemas.problem.tiers import AccuracyIn
from service.schemas.reading.choices import WireModel


class AuditIn(WireModel):
    """Another accuracy or method; what is left out or null is as in the solution's problem."""

    accuracy: AccuracyIn | None = Field(default=None, description="Another tier, tolerance or budget.")
    method: Method | None = Field(default=None, description="Another method.")


def audited_problem(problem: dict[str, object], document: dict[str, object]) -> dict[str, object]:
    """Return the ``problem`` with what a valid ``document`` of an audit changes of it."""
    return {**problem, **{name: value for name, value in document.items() if value is not None}}
