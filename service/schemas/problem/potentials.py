"""The `potential` of a problem document: expression, gravity, rational, homogeneous, general."""

from collections.abc import Iterator, Mapping, Sequence, Set
from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, InvalidNumberError, UndefinedConstantError
from service.dynamics.exact import exact_number
from service.dynamics.formula.parameters import bound_formula, require_parameter_names
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import MAX_CHARACTERS, format_tree
from service.dynamics.potentials.families import coefficients
from service.dynamics.potentials.families.general_solution import QUADRANTS
from service.dynamics.potentials.families.written import expression_potential, general_potential
from service.dynamics.potentials.terms import MAX_TERMS
from service.schemas.problem.trusted import DEFAULT_ANGLE, formula_of, potential_of
from service.schemas.reading.documents import Document, Fault, fault_of
from service.schemas.reading.numbers import Exact, read_exact, refuse
from service.schemas.reading.parts import (
    TAG_MARK,
    Section,
    fields_of,
    given,
    left_out,
    one_of_each,
    require_kind,
    tag_by_type,
)

MAX_PARAMETERS = 100

Parameters = Annotated[dict[str, Exact], Field(max_length=MAX_PARAMETERS)]

STAND_IN = RigidBody(Fraction(17), Fraction(19), Fraction(23))
"""A body without simple relations between its moments: for checking formulas when the body is faulty."""


class PotentialModel(Section):
    """A potential as a client states it. Reading it checks its form; ``errors`` lists what else is wrong."""

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield every error that prevents this from being a potential of ``body``."""
        try:
            potential_of(fields_of(self), body)
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


_VARIABLES = {"F": "w", "G": "g2"}
_F_FIELDS = tuple(f"F_{quadrant}" for quadrant in QUADRANTS)
_G_FIELDS = tuple(f"G_{quadrant}" for quadrant in QUADRANTS)
_FIELDS = {
    name: variable
    for function, variable in _VARIABLES.items()
    for name in (function, *(f"{function}_{quadrant}" for quadrant in QUADRANTS))
}
"""The formula fields, each with its variable."""
_OF_ONE_QUADRANT = "Formula for this pair of signs of g1 and g3: p is plus, m minus."


def read_angle(value: object) -> str:
    """Return a formula; a number is converted to an exact ratio."""
    if isinstance(value, bool) or not isinstance(value, int | float | str | Fraction):
        raise refuse("invalid_type", 'a number, or a formula such as "pi/4", is expected')
    number: object = value
    if isinstance(value, str):
        try:
            number = exact_number(value)
        except InvalidNumberError:
            return value
    return str(read_exact(number))


Angle = Annotated[
    str,
    PlainValidator(read_angle),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "examples": ["pi/4"]}]}),
]


class GeneralIn(FormulaModel):
    """V1[F] + (A g1² + C g3²) G(g2), whose motions have the energy -F(w)."""

    model_config = one_of_each([given("F"), given(*_F_FIELDS)], [left_out(*_G_FIELDS), given(*_G_FIELDS)])

    type: Literal["general"] = Field(description="Says which family this is.")
    F: str | None = Field(default=None, description="Formula in w for all quadrants.", examples=["k*w"])
    F_pp: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    F_mp: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    F_pm: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    F_mm: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    G: str | None = Field(default=None, description="Formula in g2 for all quadrants; 0 if left out.")
    G_pp: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    G_mp: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    G_pm: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    G_mm: str | None = Field(default=None, description=_OF_ONE_QUADRANT)
    reference_angle: Angle = Field(
        default=DEFAULT_ANGLE,
        description="atan2(|g3|, |g1|) where V1 = 0, in radians; a formula without variables.",
    )

    @model_validator(mode="after")
    def _of_all_quadrants(self) -> Self:
        for below, code, message in quadrant_faults(set(self._texts())):
            raise refuse(code, message, below=below)
        return self

    def canonical(self) -> Document:
        """Return the canonical document: formulas printed by our printer, equal ones merged."""
        formulas: dict[str, str] = {}
        for function in _VARIABLES:
            given = formula_of(fields_of(self), function)
            texts = [given] if isinstance(given, str) else [given[quadrant] for quadrant in QUADRANTS]
            printed = [format_tree(parse(text)) for text in texts]
            if len(set(printed)) == 1:
                formulas[function] = printed[0]
            else:
                formulas |= {f"{function}_{q}": text for q, text in zip(QUADRANTS, printed, strict=True)}
        return {
            "type": self.type,
            **formulas,
            "parameters": self.canonical_parameters(),
            "reference_angle": format_tree(parse(self.reference_angle)),
        }

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield the errors of the names, the formulas and the angle."""
        found = list(_errors(self._texts(), self.reference_angle, self.parameters, body))
        yield from found or super().errors(body)

    @classmethod
    def faults_of_unread(cls, document: Mapping[object, object], body: RigidBody | None) -> Iterator[Fault]:
        """Yield the faults of the choice of formulas, the texts and the names."""
        texts = {name: text for name in _FIELDS if isinstance(text := document.get(name), str)}
        for field, code, message in quadrant_faults(
            {name for name in _FIELDS if document.get(name) is not None}
        ):
            yield Fault(f"/potential/{field}", code, message)
        stand_ins = stand_in_parameters(document.get("parameters"))
        if stand_ins is not None:
            for error in _errors(texts, "pi/4", stand_ins, STAND_IN):
                if not isinstance(error, UndefinedConstantError):
                    yield fault_of(error)

    def _texts(self) -> dict[str, str]:
        given = {name: getattr(self, name) for name in _FIELDS}
        return {name: text for name, text in given.items() if text is not None}


def quadrant_faults(given: Set[str]) -> Iterator[tuple[str, str, str]]:
    """Yield field, code and message of each fault in the choice among F, F_pp, …, G, G_pp, …."""
    for function in _VARIABLES:
        fields = [f"{function}_{quadrant}" for quadrant in QUADRANTS]
        accepted = f'accepted are "{function}", or all of {", ".join(fields)}'
        present = [field for field in fields if field in given]
        if function in given:
            for field in present:
                yield field, "conflicting_fields", f'"{function}" stands for all quadrants; {accepted}'
        elif present:
            for field in fields:
                if field not in given:
                    yield field, "missing_field", f'"{field}" is missing; {accepted}'
        elif function == "F":
            yield function, "missing_field", f'"F" is missing; {accepted}'


def _errors(
    texts: Mapping[str, str], angle: str, parameters: Mapping[str, Fraction], body: RigidBody
) -> Iterator[DynamicsError]:
    """Yield the faults of each part by itself."""
    good = dict(parameters)
    for name, value in parameters.items():
        try:
            general_potential(STAND_IN, "0", "0", {name: value})
        except DynamicsError as error:
            del good[name]
            yield error
    for field, text in texts.items():
        try:
            bound_formula(text, (_FIELDS[field],), good, body, f"/potential/{field}")
        except DynamicsError as error:
            yield error
    try:
        general_potential(body, "0", "0", good, angle)
    except DynamicsError as error:
        yield error


class ExpressionIn(FormulaModel):
    """A formula in g1, g2, g3, named parameters and the moments A, B, C."""

    type: Literal["expression"] = Field(description="Says which family this is.")
    expression: str = Field(
        description=f"Of `+ - * / ^ **`, parentheses, numbers, `sqrt exp log sin cos tan abs`, `pi`;"
        f" at most {MAX_CHARACTERS} characters.",
        examples=["a*g1 + b/g3^2"],
    )

    def canonical(self) -> Document:
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

    def canonical(self) -> Document:
        """Return the document with every field."""
        return {"type": self.type, "a": str(self.a), "b": str(self.b), "c": str(self.c)}


Coefficients = Annotated[list[Exact], Field(max_length=MAX_TERMS)]


class RationalIn(PotentialModel):
    """The rational family of bodies with A = 2C; the lists begin with a1, b1 and c1."""

    type: Literal["rational"] = Field(description="Says which family this is.")
    a: Coefficients = Field(default_factory=list, description="a1, a2, ...; zeros if left out.")
    b: Coefficients = Field(default_factory=list, description="b1, b2, ...; zeros if left out.")
    c: Coefficients = Field(default_factory=list, description="c1, c2, ...; zeros if left out.")

    def canonical(self) -> Document:
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

    def canonical(self) -> Document:
        """Return the document; zeros at the ends of the lists say nothing and go."""
        lists = {"A": self.A, "B": self.B, "C": self.C, "log": self.log}
        return {"type": self.type} | {name: _trimmed(values) for name, values in lists.items()}

    def errors(self, body: RigidBody) -> Iterator[DynamicsError]:
        """Yield an error for every coefficient that has no term."""
        found = list(coefficients.refusals(body, A=self.A, B=self.B, C=self.C, log=self.log))
        yield from found or super().errors(body)

    @classmethod
    def faults_of_unread(cls, document: Mapping[object, object], body: RigidBody | None) -> Iterator[Fault]:
        """Yield a fault for every readable coefficient that has no term."""
        if body is not None:
            lists = {name: _readable(document.get(name)) for name in ("A", "B", "C", "log")}
            yield from map(fault_of, coefficients.refusals(body, **lists))


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
