"""The answers of studies."""

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.verdict import BallOut


class EnclosedOut(ResponseModel):
    """A number with the radius within which the true one is proved to be, both as decimals."""

    value: str = Field(description="The number.")
    radius: str = Field(
        description="Of what is proved: the true number is no farther away. Of what is possible: an estimate."
    )


class FoundOut(ResponseModel):
    """Numbers that give what is wanted."""

    values: dict[str, EnclosedOut] = Field(description="Of the unknowns, by their pointers.")
    window: int = Field(description="Number of the window of the motion, as `motion.window` counts them.")
    proof: Literal["proved", "possible"] = Field(
        description="`proved`: within the radii there is a solution, and no other unless a trace is wanted."
        " `possible`: doubles show one."
    )


class NumbersOut(ResponseModel):
    """The numbers of a problem that give what is wanted."""

    solutions: list[FoundOut] = Field(description="In the order of the first unknown.")
    rest: Literal["proved_empty", "undecided"] = Field(
        description="`proved_empty`: there are no other solutions. `undecided`: that is not proved."
    )
    undecided: list[list[list[float]]] = Field(
        description="Boxes in which the rest is not decided, each with the two ends of every unknown."
    )


class StateOut(ResponseModel):
    """A state; exact ratios if there is no radius."""

    omega: list[str] = Field(description="p, q, r.")
    gamma: list[str] = Field(description="g1, g2, g3.")
    radius: str | None = Field(description="Of each number; null if they are exact.")


class RefutationOut(ResponseModel):
    """A state at which a function changes."""

    state: StateOut = Field(description="On the level and the relations that were asked about.")
    letters: dict[str, str] = Field(description="The numbers that were put in for letters.")
    rate: BallOut = Field(description="The rate of the function there; it is not 0.")


class IntegralOut(ResponseModel):
    """The answer to whether a function is an integral, or its vanishing an invariant relation."""

    verdict: Literal["integral", "not_integral", "invariant_relation", "not_invariant", "undecided"] = Field(
        description="The first two for a function, the next two for a relation."
    )
    proof: Literal["symbolic", "counterexample"] | None = Field(description="Null if it is undecided.")
    holds: Literal["always", "zero_areas", "relations"] | None = Field(
        description="The widest set of motions for which it is proved."
    )
    counterexample: RefutationOut | None = Field(
        description="Refutes the next wider set of motions, or the question itself."
    )
    multiplier: str | None = Field(description="μ of f' = μ f, where it is a polynomial.")
    independent: bool | None = Field(
        description="Functionally independent of the energy, the areas and the length of γ; null: not known."
    )
    minor: BallOut | None = Field(description="A determinant of derivatives that proves independence.")
    dependence: str | None = Field(description="A polynomial in I, H and I3 that is 0, if it is dependent.")
    name: str | None = Field(description="Of a known integral.")
    except_where: list[str] = Field(description="Where one of these is 0, nothing is claimed.")


class DegreesOut(ResponseModel):
    """Degrees in the two groups of variables."""

    omega: int = Field(description="In p, q, r.")
    gamma: int = Field(description="In g1, g2, g3, on the sphere.")


class FoundIntegralOut(ResponseModel):
    """A polynomial integral."""

    expression: str = Field(description="In p, q, r, g1, g2, g3 and the letters.")
    name: str | None = Field(description="Of a known one.")
    degree: DegreesOut = Field(description="Its degrees.")


class SpecialIntegralsOut(ResponseModel):
    """Values of the letters at which there are more integrals."""

    conditions: list[str] = Field(description="Formulas that are 0 there.")
    integrals: list[FoundIntegralOut] = Field(description="All integrals there.")
    resolved: bool = Field(description="False: it was not found whether there are more.")


class IntegralsOut(ResponseModel):
    """The polynomial integrals up to a degree."""

    integrals: list[FoundIntegralOut] = Field(description="For all values of the letters.")
    special: list[SpecialIntegralsOut] = Field(description="Where there are more.")
    unknowns: int = Field(description="Coefficients that were solved for.")
    complete: bool = Field(description="False: there may be more special values, since the time was over.")


class ExpressionOut(ResponseModel):
    """A potential."""

    expression: str = Field(description="In g1, g2, g3.")


class RatioOut(ResponseModel):
    """A ratio of moments at which more potentials are admissible."""

    ratio: str = Field(description="A/C.")
    dimension: int = Field(description="Of all admissible ones.")
    potentials: list[ExpressionOut] = Field(description="The further ones.")


class PotentialsOut(ResponseModel):
    """The polynomial potentials up to a degree that admit planar motions."""

    potentials: list[ExpressionOut] = Field(description="A basis; the constant is among them.")
    dimension: int = Field(description="Their number.")
    ratios: list[RatioOut] = Field(description="Where no body was given: ratios with more.")


AnswerOut = IntegralOut | IntegralsOut | PotentialsOut | NumbersOut
Answer = type[IntegralOut] | type[IntegralsOut] | type[PotentialsOut] | type[NumbersOut]
ANSWERS: Mapping[str, Answer] = {
    "integral": IntegralOut,
    "integrals": IntegralsOut,
    "potentials": PotentialsOut,
    "numbers": NumbersOut,
}
"""The answers by the kind of question."""


def describe_answer(answer: Mapping[str, object]) -> str:
    """Return an answer as lines for people."""
    return "\n".join(_lines(answer, ""))


def _lines(value: object, indent: str) -> Iterator[str]:
    if isinstance(value, Mapping) and set(value) == {"value", "radius"}:
        yield f"{indent}{value['value']} ± {value['radius']}"
    elif isinstance(value, Mapping):
        for name, part in value.items():
            lines = list(_lines(part, ""))
            if len(lines) == 1:
                yield f"{indent}{name}: {lines[0]}"
            else:
                yield f"{indent}{name}:"
                yield from (f"{indent}  {line}" for line in lines)
    elif isinstance(value, list) and not all(isinstance(part, int | float) for part in value):
        for part in value:
            first, *others = _lines(part, "")
            yield f"{indent}- {first}"
            yield from (f"{indent}  {line}" for line in others)
    elif isinstance(value, list):
        yield f"{indent}{' to '.join(f'{part:.15g}' for part in value) or 'none'}"
    else:
        yield f"{indent}{value}"
