"""Errors as RFC 9457 has them: application/problem+json."""

from pydantic import Field

from service.schemas.job import JobItemOut
from service.schemas.verdict import (
    CounterexampleOut,
    EvidenceOut,
    ExistenceOut,
    MotionWindowOut,
    ResponseModel,
)


class FaultOut(ResponseModel):
    """One thing wrong with a request."""

    pointer: str = Field(description="JSON pointer into the body; `?name` is a query parameter.")
    code: str = Field(description="Stable word for programs.")
    message: str = Field(description="Sentence for people; says what would have been accepted.")


class ProblemDetailsOut(ResponseModel):
    """Why a request was not done. What does not apply is left out."""

    type: str = Field(description="`urn:polhode:problem:` and the code.")
    title: str = Field(description="The kind of refusal in a few words; the same for all with this type.")
    status: int = Field(description="The HTTP status, again.")
    detail: str = Field(description="What is wrong with this very request, for people.")
    errors: list[FaultOut] = Field(description="Every fault of the request.")
    counterexample: CounterexampleOut = Field(description="With `inadmissible_potential`.")
    evidence: EvidenceOut = Field(description="With `undecided_potential`.")
    existence: ExistenceOut = Field(
        description="With `no_motion`: for which λ there are motions. In a list of jobs it is left out where"
        " too many problems are refused."
    )
    windows: list[MotionWindowOut] = Field(description="With `several_windows` and `no_such_window`.")
    items: list[JobItemOut] = Field(
        description="With `no_problem_accepted`: what refuses each problem of the list, in its order."
    )
    checks: dict[str, str] = Field(description="With `not_ready`.")
    needed_role: str = Field(description="With `role_insufficient`.")
    request_id: str = Field(description="Also in the header X-Request-ID, and in the log of the service.")
