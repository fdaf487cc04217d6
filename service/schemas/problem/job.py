"""The document that submits a job: a problem, and the labels and the note of its sender."""

from pydantic import Field

from service.schemas.problem.sections import ProblemIn
from service.schemas.reading.marks_in import LABELS_HELP, NOTE_HELP, Labels, Note


class JobIn(ProblemIn):
    """A problem with labels and a note, which are no part of it: what ``POST /v1/jobs`` takes."""

    labels: Labels = Field(default_factory=dict, description=LABELS_HELP)
    note: Note | None = Field(default=None, description=NOTE_HELP)
