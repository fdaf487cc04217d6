"""A query for rows of a list, as it has been read."""

from dataclasses import dataclass

from service.schemas.query.conditions import Condition, OrderKey, Subject, Value
from service.schemas.query.kinds import Kind

ID = Subject("fact", "id", Kind.IDENTIFIER)


@dataclass(frozen=True, slots=True)
class ListQuery:
    """The rows asked for; every condition must hold."""

    conditions: tuple[Condition, ...] = ()
    order: tuple[OrderKey, ...] = (OrderKey(ID, descending=True),)
    """The id is added as the last column, in the direction of the one before."""
    columns: tuple[Subject, ...] = ()
    """Values that are wanted beside the ids."""
    limit: int = 50
    offset: int = 0
    after: tuple[Value | None, ...] | None = None
    """The values of the order's columns, id included, in the row before the page."""
    is_counted: bool = True
    """Whether the number of all such rows is wanted."""
    count_limit: int | None = None
    """It is wanted only if it is at most so large."""
    is_estimated: bool = False
    """Whether it is only asked what of it takes long."""

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The columns of the order; the last one is the id."""
        for place, key in enumerate(self.order):
            if key.subject == ID:
                return self.order[: place + 1]
        return (*self.order, OrderKey(ID, self.order[-1].descending))


def equals(name: str, kind: Kind, value: Value | None) -> tuple[Condition, ...]:
    """Return the condition that a fact has a value; none if the value is None."""
    return () if value is None else (Condition(Subject("fact", name, kind), "=", (value,)),)


def in_state(state: str | None) -> tuple[Condition, ...]:
    """Return the condition for a state; none for any state."""
    return equals("state", Kind.WORD, state)
