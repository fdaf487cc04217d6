"""Potentials on the wire."""

from fractions import Fraction
from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from service.dynamics.body import RigidBody
from service.dynamics.formula.limits import MAX_CHARACTERS
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.potentials.expression import expression_potential
from service.dynamics.potentials.gravity import gravity_potential
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.rational import MAX_TERMS, rational_potential, require_rational_body
from service.schemas.choices import TAG_MARK, WireModel, require_kind, tag_by_type
from service.schemas.numbers import Exact

MAX_PARAMETERS = 100


class ExpressionIn(WireModel):
    """A formula in g1, g2, g3, named parameters and the moments A, B, C."""

    type: Literal["expression"]
    expression: str = Field(
        description=f"`+ - * / ^ **`, parentheses, numbers, `sqrt exp log sin cos tan abs`, `pi`;"
        f" at most {MAX_CHARACTERS} characters",
        examples=["a*g1 + b/g3^2"],
    )
    parameters: Annotated[dict[str, Exact], Field(max_length=MAX_PARAMETERS)] = Field(default_factory=dict)

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential; raises what :func:`expression_potential` raises."""
        return expression_potential(self.expression, self.parameters, body)

    def canonical(self) -> dict[str, object]:
        """Return the document, with the formula printed anew and the parameters in order."""
        return {
            "type": self.type,
            "expression": format_tree(parse(self.expression)),
            "parameters": {name: str(self.parameters[name]) for name in sorted(self.parameters)},
        }


class GravityIn(WireModel):
    """The uniform field a g1 + b g2 + c g3."""

    type: Literal["gravity"]
    a: Exact = Fraction(0)
    b: Exact = Fraction(0)
    c: Exact = Fraction(0)

    def to_domain(self, _: RigidBody) -> Potential:
        """Return the potential."""
        return gravity_potential(self.a, self.b, self.c)

    def canonical(self) -> dict[str, object]:
        """Return the document with every field."""
        return {"type": self.type, "a": str(self.a), "b": str(self.b), "c": str(self.c)}


Coefficients = Annotated[list[Exact], Field(max_length=MAX_TERMS)]


class RationalIn(WireModel):
    """The rational family of bodies with A = 2C; the lists begin with a1, b1 and c1."""

    type: Literal["rational"]
    a: Coefficients = Field(default_factory=list)
    b: Coefficients = Field(default_factory=list)
    c: Coefficients = Field(default_factory=list)

    def to_domain(self, body: RigidBody) -> Potential:
        """Return the potential, or raise :class:`RationalBodyError` unless A = 2C."""
        require_rational_body(body)
        return rational_potential(self.a, self.b, self.c)

    def canonical(self) -> dict[str, object]:
        """Return the document; zeros at the ends of the lists say nothing and go."""
        lists: dict[str, object] = {}
        for name, given in (("a", self.a), ("b", self.b), ("c", self.c)):
            length = max((n for n, value in enumerate(given, start=1) if value), default=0)
            lists[name] = [str(value) for value in given[:length]]
        return {"type": self.type, **lists}


PotentialIn = Annotated[
    Annotated[ExpressionIn, Tag(f"{TAG_MARK}expression")]
    | Annotated[GravityIn, Tag(f"{TAG_MARK}gravity")]
    | Annotated[RationalIn, Tag(f"{TAG_MARK}rational")],
    Discriminator(tag_by_type),
    BeforeValidator(
        require_kind(
            ("expression", "gravity", "rational"),
            later=("homogeneous", "general"),
            models={"expression": ExpressionIn, "gravity": GravityIn, "rational": RationalIn},
        )
    ),
]
