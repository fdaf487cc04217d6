"""Writes on which classical and integrable cases a state lies, as text for people."""

from collections.abc import Iterator, Mapping

from service.schemas.replies.verdict import ClassificationOut, NearCaseOut


def describe_classification(found: ClassificationOut) -> Iterator[str]:
    """Yield the cases that the state lies on, the nearest classical one with its residuals, and the rest."""
    yield f"lies on     {', '.join(found.on) if found.on else 'no classical or integrable case'}"
    if found.nearest is not None:
        yield f"nearest     {_near(found.nearest)}"
        for name, left in found.nearest.relations.items():
            yield f"            {name}: {'no value here' if left is None else f'{left:.3g}'}"
    for case in found.cases:
        if found.nearest is None or case.case != found.nearest.case:
            yield f"also        {_near(case)}"
    for integrable in found.integrable:
        verb = "holds" if integrable.holds else "does not hold"
        yield f"integrable  {integrable.case} {verb}: {_residuals(integrable.residuals)}"


def _near(case: NearCaseOut) -> str:
    if case.is_on:
        return f"{case.case}: the state lies on it"
    return f"{case.case}: " + (
        "Newton's steps from the state lead nowhere"
        if case.distance is None
        else f"at most {case.distance:.3g} away"
    )


def _residuals(residuals: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {left:.3g}" for name, left in residuals.items())
