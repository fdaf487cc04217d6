"""The `general` potential of a problem document: F(w) and G(g2) as formulas."""

from collections.abc import Iterator, Mapping, Set
from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.formula.errors import UndefinedConstantError
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tree import Tree
from service.dynamics.inverse.named import CURVE_NAMES, Named, NamedSolution
from service.dynamics.potentials.families.general import FormulaText, general_potential
from service.dynamics.potentials.families.general_solution import QUADRANTS, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.bound_formula import bound_formula, named_formula
from service.schemas.problem.potential_model import STAND_IN, FormulaModel, stand_in_parameters
from service.schemas.reading.faults import Fault, fault_of
from service.schemas.reading.needs import given, left_out, one_of_each
from service.schemas.reading.numbers import read_exact, refuse

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
        default="pi/4", description="atan2(|g3|, |g1|) where V1 = 0, in radians; a formula without variables."
    )

    @model_validator(mode="after")
    def _of_all_quadrants(self) -> Self:
        for below, code, message in quadrant_faults(set(self._texts())):
            raise refuse(code, message, below=below)
        return self

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential; raises what :func:`general_potential` raises."""
        F, G = self._formula("F"), self._formula("G")
        return general_potential(body, F, G, self.parameters, self.reference_angle)

    def named(self, body: RigidBody) -> Named | None:
        """Return F and G on every quadrant, with the names of the parameters."""
        if not self.parameters or CURVE_NAMES & set(self.parameters):
            return None
        trees: dict[str, dict[Quadrant, Tree]] = {}
        for function, variable in _VARIABLES.items():
            given = self._formula(function)
            trees[function] = {
                quadrant: named_formula(
                    given if isinstance(given, str) else given[quadrant], (variable,), self.parameters, body
                )
                for quadrant in QUADRANTS
            }
        return NamedSolution(trees["F"], trees["G"])

    def canonical(self) -> dict[str, object]:
        """Return the canonical document: formulas printed by our printer, equal ones merged."""
        formulas: dict[str, str] = {}
        for function in _VARIABLES:
            given = self._formula(function)
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

    def _formula(self, function: str) -> FormulaText:
        texts = self._texts()
        by_quadrant = {quadrant: texts.get(f"{function}_{quadrant}") for quadrant in QUADRANTS}
        if all(text is None for text in by_quadrant.values()):
            return texts.get(function, "0")
        return {quadrant: text for quadrant, text in by_quadrant.items() if text is not None}


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
