"""Error answers: application/problem+json (RFC 9457)."""

from typing import Literal

from pydantic import Field

from service.schemas.replies.job import JobItemOut
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.verdict import CounterexampleOut, EvidenceOut, ExistenceOut, MotionWindowOut


class FaultOut(ResponseModel):
    """One fault of a request."""

    pointer: str = Field(description="JSON pointer into the body; `?name` is a query parameter.")
    code: str = Field(description="Stable code for programs.")
    message: str = Field(description="Sentence for people; says what would have been accepted.")
    position: int = Field(
        default=0,
        description="Of a fault in the language of queries: its character in the parameter, from 0.",
    )


class ProblemDetailsOut(ResponseModel):
    """Why a request was refused. Fields that do not apply are left out."""

    type: str = Field(description="`urn:polhode:problem:` and the code.")
    title: str = Field(description="The kind of refusal in a few words; the same for all with this type.")
    status: int = Field(description="The HTTP status, again.")
    detail: str = Field(description="The fault of this request, for people.")
    errors: list[FaultOut] = Field(description="Every fault of the request.")
    counterexample: CounterexampleOut = Field(
        description="With `inadmissible_potential` and `inadmissible_motion`."
    )
    evidence: EvidenceOut = Field(description="With `undecided_potential`.")
    verdict: Literal["admissible", "undecided"] = Field(
        description="With `signs_unsettled`, `essential_singularity`, `separatrix_undecided` and"
        " `passage_undecided`: the verdict on the potential, which is known although the windows are not."
    )
    existence: ExistenceOut = Field(
        description="With `no_motion`: the λ for which motions exist. Left out in a list of jobs if"
        " too many problems are refused."
    )
    windows: list[MotionWindowOut] = Field(description="With `several_windows` and `no_such_window`.")
    items: list[JobItemOut] = Field(
        description="With `no_problem_accepted`: the refusal of each problem of the list, in its order."
    )
    checks: dict[str, str] = Field(description="With `not_ready`.")
    referrers: list[str] = Field(description="With `in_use`: paths of what refers to it, 100 at most.")
    needed_role: str = Field(description="With `role_insufficient`.")
    request_id: str = Field(description="Also in the header X-Request-ID, and in the log of the service.")
