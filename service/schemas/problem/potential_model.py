"""The base class of the potentials in a problem document."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import Annotated

from pydantic import Field

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.errors import UndefinedConstantError
from service.dynamics.inverse.named import Named, NamedSum, sum_of_parts
from service.dynamics.potentials.potential import Potential
from service.schemas.reading.choices import WireModel
from service.schemas.reading.faults import Fault
from service.schemas.reading.numbers import Exact

MAX_PARAMETERS = 100

Parameters = Annotated[dict[str, Exact], Field(max_length=MAX_PARAMETERS)]

STAND_IN = RigidBody(Fraction(17), Fraction(19), Fraction(23))
"""A body without simple relations between its moments: for checking formulas when the body is faulty."""


class PotentialModel(WireModel, ABC):
    """A potential as a client states it.

    Reading a document checks its form. ``to_domain`` makes the potential for a
    body; ``errors`` lists what prevents it.
    """

    @abstractmethod
    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential; raises what its family raises."""

    @abstractmethod
    def canonical(self) -> dict[str, object]:
        """Return the canonical document: equal potentials have equal documents."""

    def named(self, body: RigidBody) -> Named | None:
        """Return the terms of the potential with the names of its parameters, None if it has none."""
        del body
        return None

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield every error that prevents this from being a potential of ``body``."""
        try:
            self.to_domain(body)
        except DynamicsError as error:
            yield error

    def text_errors(self) -> Iterator[DynamicsError]:
        """Yield the errors that do not depend on the body or the numbers."""
        yield from ()

    @classmethod
    def faults_of_unread(cls, document: Mapping[object, object], body: RigidBody | None) -> Iterator[Fault]:
        """Yield further faults of a document whose form is faulty, as far as they can be found.

        The body is None if it could not be read either.
        """
        yield from ()


def named_coefficients(
    coefficients: Mapping[str, Fraction], part: Callable[[str], Potential]
) -> NamedSum | None:
    """Return the sum of coefficients times parts, without zero coefficients."""
    values = {name: value for name, value in coefficients.items() if value}
    return sum_of_parts(values, tuple((name, part(name)) for name in values))


class FormulaModel(PotentialModel):
    """A potential with formulas in named parameters."""

    parameters: Parameters = Field(
        default_factory=dict, description="The numbers that the names in formulas stand for, by name."
    )

    def text_errors(self) -> Iterator[DynamicsError]:
        """Yield the errors of the names and the texts."""
        for error in self.errors(STAND_IN):
            # A formula that has no value with these numbers may have one with others.
            if not isinstance(error, UndefinedConstantError):
                yield error

    def canonical_parameters(self) -> dict[str, str]:
        """Return the parameters in order, as exact text."""
        return {name: str(self.parameters[name]) for name in sorted(self.parameters)}


def stand_in_parameters(given: object) -> dict[str, Fraction] | None:
    """Return stand-in numbers for unreadable parameters; None if there are too many."""
    names = [str(name) for name in given] if isinstance(given, dict) else []
    return dict.fromkeys(names, Fraction(29)) if len(names) <= MAX_PARAMETERS else None
