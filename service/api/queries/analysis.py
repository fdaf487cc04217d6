"""Reads what facets and statistics are asked for."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from pydantic import Field

from service.api.queries.lists import ESTIMATE, WHERE
from service.api.queries.queries import Asked, QueryModel, refuse_if_any
from service.schemas.query.conditions import Condition, Excerpt, Kind, Subject, split
from service.schemas.query.facts import Fact, Vocabulary
from service.schemas.query.reading import read_names, read_where
from service.schemas.reading.documents import Fault

MOST_NAMES = 8
MOST_BINS = 200


class FacetsQuery(QueryModel):
    """The conditions and facts of a request for counts of values."""

    where: list[str] = Field(default_factory=list, description=WHERE)
    by: str | None = Field(
        default=None, description="Facts such as `family,tier`, or pointers; each is counted by itself."
    )
    limit: int = Field(default=50, ge=1, le=1000, description="Values of each at most, the most frequent.")
    estimate: bool = Field(default=False, description=ESTIMATE)


class StatisticsQuery(QueryModel):
    """The conditions, numbers and groups of a request for statistics."""

    where: list[str] = Field(default_factory=list, description=WHERE)
    of: str | None = Field(default=None, description="Numbers such as `period,/motion/lambda`.")
    by: str | None = Field(
        default=None, description="A fact or pointer whose values divide them into groups."
    )
    bins: int = Field(default=0, ge=0, le=MOST_BINS, description="Bins of a histogram; none if left out.")
    limit: int = Field(default=20, ge=1, le=200, description="Groups at most, the largest.")
    estimate: bool = Field(default=False, description=ESTIMATE)


@dataclass(frozen=True, slots=True)
class Analysis:
    """The conditions, subjects and groups of a request for facets or statistics."""

    conditions: tuple[Condition, ...]
    of: tuple[Subject, ...]
    by: tuple[Subject, ...]


def read_facets(asked: Asked[FacetsQuery], vocabulary: Vocabulary) -> Analysis:
    """Return what is counted; raises the refusal with every fault."""
    faults = list(asked.faults)
    conditions, of_where = read_where(asked.parameters.where, vocabulary)
    by, of_by = _names("by", asked.parameters.by, _groupable(vocabulary))
    if asked.parameters.by is None:
        faults.append(Fault("?by", "missing_parameter", f"by is missing; {vocabulary.accepted()}"))
    refuse_if_any([*faults, *of_where, *of_by])
    return Analysis(conditions, (), by)


def read_statistics(asked: Asked[StatisticsQuery], vocabulary: Vocabulary) -> Analysis:
    """Return what is summed up; raises the refusal with every fault."""
    faults = list(asked.faults)
    conditions, of_where = read_where(asked.parameters.where, vocabulary)
    numbers = replace(_only(vocabulary, lambda fact: fact.kind is Kind.NUMBER), has_labels=False)
    of, of_of = _names("of", asked.parameters.of, numbers)
    by, of_by = _names("by", asked.parameters.by, _groupable(vocabulary))
    if asked.parameters.of is None:
        faults.append(Fault("?of", "missing_parameter", f"of is missing; {numbers.accepted()}"))
    if len(by) > 1:
        faults.append(Fault("?by", "too_many_columns", f"{len(by)} facts; one is accepted"))
    refuse_if_any([*faults, *of_where, *of_of, *of_by])
    return Analysis(conditions, of, by)


def _groupable(vocabulary: Vocabulary) -> Vocabulary:
    """Return what rows can have in common: not ids and instants."""
    return _only(vocabulary, lambda fact: fact.kind not in (Kind.IDENTIFIER, Kind.INSTANT))


def _only(vocabulary: Vocabulary, accept: Callable[[Fact], bool]) -> Vocabulary:
    facts = {name: fact for name, fact in vocabulary.facts.items() if accept(fact)}
    return replace(vocabulary, facts=facts)


def _names(
    parameter: str, text: str | None, vocabulary: Vocabulary
) -> tuple[tuple[Subject, ...], list[Fault]]:
    if text is None:
        return (), []
    parts = list(split(Excerpt(text, 0)))
    if len(parts) > MOST_NAMES:
        message = f"{len(parts)} names; at most {MOST_NAMES} are accepted"
        return (), [Fault(f"?{parameter}", "too_many_columns", message)]
    return read_names(parameter, parts, vocabulary)
