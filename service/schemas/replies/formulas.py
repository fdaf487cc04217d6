"""Formulas of an answer, ready to be shown."""

from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import QuadrantOut, ResponseModel


class FormulaFormatsOut(ResponseModel):
    """One equation in several formats."""

    text: str = Field(description="In the grammar of formulas, but for the time, `cn` and `K(m)`.")
    latex: str | None = Field(description="For mathematics mode; null if it was not asked for.")
    mathml: str | None = Field(
        description="Presentation MathML: one `math` element; null if it was not asked for."
    )


class FormulaOut(ResponseModel):
    """An equation that can be shown as it is."""

    name: Literal[
        "V",
        "h",
        "F",
        "G",
        "nearest",
        "curve",
        "p_squared",
        "speed_squared",
        "time",
        "g1",
        "cn",
        "x1",
        "x2",
        "k",
        "Omega",
        "kappa",
        "m",
        "period",
    ] = Field(
        description="What it is about. `curve`: g3² on the curve. `p_squared`, `speed_squared`, `time`: p²,"
        " (dg1/dt)² and the time as an integral over g1, on the curve. `g1` and all after it: the motion in"
        " elliptic functions, if it has them, of the time since |g1| was smallest."
    )
    formats: FormulaFormatsOut = Field(description="The equation, in every format that was asked for.")
    simplified: bool = Field(
        description="`formats` show the shortest form that was found and proved to be the same function."
        " False: there was no time, or nothing to simplify; the formula is shown as it stands."
    )
    named: bool = Field(
        description="It has the names of the client's parameters in it, and holds for all their values."
    )
    at: list[str] = Field(
        description="JSON pointers to the fields of this answer that it is another form of."
    )
    quadrants: list[QuadrantOut] = Field(description="Signs of g1 and g3 for which it holds.")
    g2_sign: Literal[1, -1] | None = Field(description="Sign of g2 for which it holds; null: for both.")
    window: int | None = Field(description="Number of the window whose motion it is; null: of none.")
