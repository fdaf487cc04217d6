"""A verdict, or the refusal of one, for people."""

import json
from collections.abc import Iterator, Mapping
from fractions import Fraction

from pydantic import BaseModel, ConfigDict, Field

from service.schemas.existence_text import existence_sentence
from service.schemas.faults import Fault
from service.schemas.verdict import FunctionOut, MotionWindowOut, VerdictOut

_PROOFS = {
    "symbolic": "proved: the compatibility equation holds identically",
    "counterexample": "proved by a point where the compatibility equation fails",
    "numeric": "not proved",
}


class Refusal(BaseModel):
    """Why an examination came to no verdict, or to a motion that cannot be solved for."""

    model_config = ConfigDict(extra="allow")

    code: str
    detail: str
    pointer: str
    faults: list[Fault] = Field(default_factory=list)

    def reason(self) -> str:
        """Return each fault with its place, or the one sentence and what it rests on."""
        if self.faults:
            return "\n".join(f"{f.pointer or '/'}: {f.message} ({f.code})" for f in self.faults)
        evidence = [f"  {name}: {json.dumps(value)}" for name, value in (self.model_extra or {}).items()]
        return "\n".join([f"{self.code}: {self.detail}", *evidence])


class Answer(BaseModel):
    """What an examination hands back: a verdict (null for a state), or an error."""

    verdict: VerdictOut | None = None
    error: Refusal | None = None


def describe_verdict(verdict: VerdictOut) -> str:
    """Return a few lines that say what was found, and how it is known."""
    return "\n".join(_lines(verdict))


def _lines(verdict: VerdictOut) -> Iterator[str]:
    if verdict.verdict is not None and verdict.proof is not None:
        yield f"verdict     {verdict.verdict}"
        yield f"proof       {_PROOFS[verdict.proof]}"
    if verdict.energy is not None:
        yield from _by_quadrant("energy      h", dict(verdict.energy.quadrants))
    if verdict.decomposition is not None:
        parts = [(q, part) for q, part in verdict.decomposition.quadrants if part is not None]
        yield from _by_quadrant("V1[F], F(w)", {quadrant: part.F for quadrant, part in parts})
        yield from _by_quadrant("Q G,  G(g2)", {quadrant: part.G for quadrant, part in parts})
    if verdict.counterexample is not None:
        residual = verdict.counterexample.residual
        yield f"at          (g1, g2, g3) = ({', '.join(verdict.counterexample.g)})"
        yield f"residual    {residual.mid} ± {residual.rad}"
    if verdict.nearest is not None:
        distance = float(Fraction(verdict.nearest.relative_squared_distance))
        yield (
            f"nearest     {verdict.nearest.expression} (relative squared distance {distance:.6g}, "
            f"least up to degree {verdict.nearest.degree})"
        )
    for warning in verdict.warnings:
        yield f"warning     {warning.message} ({warning.code})"
    if verdict.evidence is not None:
        evidence = verdict.evidence
        yield (
            f"evidence    the residual at {evidence.points} points, enclosed with {evidence.bits} bits: "
            f"none excludes 0, the largest is {evidence.largest_enclosure}"
        )
    if verdict.motions is not None:
        if not verdict.motions:
            yield "motions     none with this lambda and these signs of g1 and g3"
            if verdict.existence is not None:
                yield f"            {existence_sentence(verdict.existence)}"
        for window in verdict.motions:
            yield f"window {window.window:<4} {_window(window)}"


def _by_quadrant(what: str, functions: Mapping[str, FunctionOut | None]) -> Iterator[str]:
    """Yield a function, or one for each quadrant where they differ."""
    texts = {
        quadrant: _function(function) for quadrant, function in functions.items() if function is not None
    }
    if len(set(texts.values())) == 1:
        yield f"{what} = {next(iter(texts.values()))}"
        return
    for quadrant, text in texts.items():
        signs = quadrant.replace("p", "+").replace("m", "-")
        yield f"{what} = {text} (signs of g1, g3: {signs})"


def _function(function: FunctionOut) -> str:
    if function.formula is None:
        return "no formula; its values are in the JSON"
    return function.formula if function.named is None else f"{function.formula} = {function.named}"


def _window(window: MotionWindowOut) -> str:
    (inner, outer), (first, last), (lowest, highest) = window.ends, window.g1, window.g2
    return (
        f" {window.kind}, {inner} to {outer}, g1 from {first:.12g} to {last:.12g}, "
        f"g2 from {lowest:.12g} to {highest:.12g}"
    )
