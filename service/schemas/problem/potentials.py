"""The `potential` of a problem document: expression, gravity, rational, homogeneous."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.limits import MAX_CHARACTERS
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.inverse.named import Named, named_sum
from service.dynamics.potentials.families import homogeneous
from service.dynamics.potentials.families.expression import expression_potential
from service.dynamics.potentials.families.gravity import gravity_potential
from service.dynamics.potentials.families.rational import rational_potential, require_rational_body
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.bound_formula import named_formula, require_parameter_names
from service.dynamics.potentials.terms.powers import MAX_TERMS
from service.schemas.problem.general_potential import GeneralIn
from service.schemas.problem.potential_model import (
    FormulaModel,
    PotentialModel,
    named_coefficients,
    stand_in_parameters,
)
from service.schemas.reading.choices import TAG_MARK, require_kind, tag_by_type
from service.schemas.reading.faults import Fault, fault_of
from service.schemas.reading.numbers import Exact, read_exact


class ExpressionIn(FormulaModel):
    """A formula in g1, g2, g3, named parameters and the moments A, B, C."""

    type: Literal["expression"] = Field(description="Says which family this is.")
    expression: str = Field(
        description=f"Of `+ - * / ^ **`, parentheses, numbers, `sqrt exp log sin cos tan abs`, `pi`;"
        f" at most {MAX_CHARACTERS} characters.",
        examples=["a*g1 + b/g3^2"],
    )

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential; raises what :func:`expression_potential` raises."""
        return expression_potential(self.expression, self.parameters, body)

    def named(self, body: RigidBody) -> Named | None:
        """Return the terms of the formula, each with its product of parameters."""
        return named_sum(named_formula(self.expression, VARIABLES, self.parameters, body), self.parameters)

    def canonical(self) -> dict[str, object]:
        """Return the canonical document: the formula printed by our printer, parameters in order."""
        return {
            "type": self.type,
            "expression": format_tree(parse(self.expression)),
            "parameters": self.canonical_parameters(),
        }

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield the errors of the names and that of the formula."""
        good = dict(self.parameters)
        for name, value in self.parameters.items():
            try:
                require_parameter_names({name: value})
            except DynamicsError as error:
                del good[name]
                yield error
        try:
            expression_potential(self.expression, good, body)
        except DynamicsError as error:
            yield error

    @classmethod
    def faults_of_unread(cls, document: Mapping[object, object], _: RigidBody | None) -> Iterator[Fault]:
        """Yield the faults of the text and the names, which do not depend on the numbers."""
        text, stand_ins = document.get("expression"), stand_in_parameters(document.get("parameters"))
        if isinstance(text, str) and stand_ins is not None:
            model = cls(type="expression", expression=text, parameters=stand_ins)
            yield from map(fault_of, model.text_errors())


class GravityIn(PotentialModel):
    """The uniform field a g1 + b g2 + c g3."""

    type: Literal["gravity"] = Field(description="Says which family this is.")
    a: Exact = Field(default=Fraction(0), description="Of g1; 0 if left out.")
    b: Exact = Field(default=Fraction(0), description="Of g2; 0 if left out.")
    c: Exact = Field(default=Fraction(0), description="Of g3; 0 if left out.")

    def to_domain(self, _: RigidBody) -> Potential:
        """Return the potential."""
        return gravity_potential(self.a, self.b, self.c)

    def named(self, _: RigidBody) -> Named | None:
        """Return a g1, b g2 and c g3."""

        def part(name: str) -> Potential:
            a, b, c = (Fraction(int(name == each)) for each in ("a", "b", "c"))
            return gravity_potential(a, b, c)

        return named_coefficients({"a": self.a, "b": self.b, "c": self.c}, part)

    def canonical(self) -> dict[str, object]:
        """Return the document with every field."""
        return {"type": self.type, "a": str(self.a), "b": str(self.b), "c": str(self.c)}


Coefficients = Annotated[list[Exact], Field(max_length=MAX_TERMS)]


class RationalIn(PotentialModel):
    """The rational family of bodies with A = 2C; the lists begin with a1, b1 and c1."""

    type: Literal["rational"] = Field(description="Says which family this is.")
    a: Coefficients = Field(default_factory=list, description="a1, a2, ...; zeros if left out.")
    b: Coefficients = Field(default_factory=list, description="b1, b2, ...; zeros if left out.")
    c: Coefficients = Field(default_factory=list, description="c1, c2, ...; zeros if left out.")

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential, or raise :class:`RationalBodyError` unless A = 2C."""
        require_rational_body(body)
        return rational_potential(self.a, self.b, self.c)

    def named(self, _: RigidBody) -> Named | None:
        """Return the terms with their coefficients a1, a2, …, b1, …, c1, …."""
        lists = {"a": self.a, "b": self.b, "c": self.c}

        def part(name: str) -> Potential:
            a, b, c = (_unit(name, letter, start=1) for letter in lists)
            return rational_potential(a, b, c)

        return named_coefficients(_numbered(lists, start=1), part)

    def canonical(self) -> dict[str, object]:
        """Return the document; zeros at the ends of the lists say nothing and go."""
        return {"type": self.type, "a": _trimmed(self.a), "b": _trimmed(self.b), "c": _trimmed(self.c)}


class HomogeneousIn(PotentialModel):
    """The homogeneous family of any A ≠ C; the lists begin with the index 0."""

    type: Literal["homogeneous"] = Field(description="Says which family this is.")
    A: Coefficients = Field(default_factory=list, description="Of g2^n (A g1² + C g3²).")
    B: Coefficients = Field(default_factory=list, description="Of the terms of degree 2 (A-C) (n+1)/A.")
    C: Coefficients = Field(default_factory=list, description="Of the terms of degree -2 (A-C) (n+1)/C.")
    log: Coefficients = Field(
        default_factory=list,
        description="Of the logarithmic terms: where B_n, or C_n for A < C, is undefined or a multiple of Q.",
    )

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential; raises what :func:`homogeneous_potential` raises."""
        return homogeneous.homogeneous_potential(body, A=self.A, B=self.B, C=self.C, log=self.log)

    def canonical(self) -> dict[str, object]:
        """Return the document; zeros at the ends of the lists say nothing and go."""
        lists = {"A": self.A, "B": self.B, "C": self.C, "log": self.log}
        return {"type": self.type} | {name: _trimmed(values) for name, values in lists.items()}

    def named(self, body: RigidBody) -> Named | None:
        """Return the terms with their coefficients A0, A1, …, B0, …, C0, …, log0, …."""
        lists = {"A": self.A, "B": self.B, "C": self.C, "log": self.log}

        def part(name: str) -> Potential:
            units = {letter: _unit(name, letter, start=0) for letter in lists}
            return homogeneous.homogeneous_potential(body, **units)

        return named_coefficients(_numbered(lists, start=0), part)

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield an error for every coefficient that has no term."""
        found = list(homogeneous.refusals(body, A=self.A, B=self.B, C=self.C, log=self.log))
        yield from found or super().errors(body)

    @classmethod
    def faults_of_unread(cls, document: Mapping[object, object], body: RigidBody | None) -> Iterator[Fault]:
        """Yield a fault for every readable coefficient that has no term."""
        if body is not None:
            lists = {name: _readable(document.get(name)) for name in ("A", "B", "C", "log")}
            yield from map(fault_of, homogeneous.refusals(body, **lists))


MODELS: dict[str, type[PotentialModel]] = {
    "expression": ExpressionIn,
    "gravity": GravityIn,
    "rational": RationalIn,
    "homogeneous": HomogeneousIn,
    "general": GeneralIn,
}
"""The potentials by their ``type``."""

PotentialIn = Annotated[
    Annotated[ExpressionIn, Tag(f"{TAG_MARK}expression")]
    | Annotated[GravityIn, Tag(f"{TAG_MARK}gravity")]
    | Annotated[RationalIn, Tag(f"{TAG_MARK}rational")]
    | Annotated[HomogeneousIn, Tag(f"{TAG_MARK}homogeneous")]
    | Annotated[GeneralIn, Tag(f"{TAG_MARK}general")],
    Discriminator(tag_by_type),
    BeforeValidator(require_kind(tuple(MODELS), models=MODELS)),
]


def _numbered(lists: Mapping[str, Sequence[Fraction]], *, start: int) -> dict[str, Fraction]:
    """Return the coefficients of lists by names such as a1, with the number of the term."""
    return {
        f"{letter}{n}": value
        for letter, coefficients in lists.items()
        for n, value in enumerate(coefficients, start=start)
    }


def _unit(name: str, letter: str, *, start: int) -> list[Fraction]:
    """Return the list ``letter`` whose one coefficient other than 0 has ``name``."""
    number = name.removeprefix(letter)
    return [Fraction(0)] * (int(number) - start) + [Fraction(1)] if number.isdigit() else []


def _trimmed(coefficients: Sequence[Fraction]) -> list[str]:
    length = max((n for n, value in enumerate(coefficients, start=1) if value), default=0)
    return [str(value) for value in coefficients[:length]]


def _readable(coefficients: object) -> list[Fraction]:
    """Return the readable coefficients, with 0 for the others."""
    numbers: list[Fraction] = []
    for value in coefficients[:MAX_TERMS] if isinstance(coefficients, list) else ():
        try:
            numbers.append(read_exact(value))
        except PydanticCustomError:
            numbers.append(Fraction(0))
    return numbers
