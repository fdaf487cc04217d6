"""Audits: a stored motion is solved again by the service, and the two are compared."""

from polhode.documents.problems import Document
from polhode.errors import FailedError
from polhode.transport.exchange import ask_json
from polhode.transport.following import FINAL, follow
from polhode.transport.steps import Operation
from polhode.transport.terms import Terms

_WAIT_SECONDS = 20


class Audit:
    """A comparison of a stored motion with the same one solved again.

    Attributes
    ----------
    document
        The audit as the service tells it.
    """

    def __init__(self, document: Document) -> None:
        self.document = document

    @property
    def agrees(self) -> bool:
        """Whether all stored numbers are confirmed within the errors that both claim."""
        return self.document["verdict"] == "agrees"

    @property
    def detail(self) -> str:
        """The result in words."""
        comparison = self.document["comparison"]
        assert isinstance(comparison, dict)
        return str(comparison["detail"])

    def __repr__(self) -> str:
        return f"<audit {self.document['id']}: {self.document['verdict']}, {self.detail}>"


def audited(terms: Terms, solution_id: str, document: Document, seconds: float | None) -> Operation[Audit]:
    """Have a solution audited, and return the audit when it has ended."""
    path = f"/v1/solutions/{solution_id}/audits"
    wait = _WAIT_SECONDS if seconds is None else min(int(seconds), _WAIT_SECONDS)
    headers = {"Prefer": f"wait={wait}"} if wait else {}
    audit = yield from ask_json(terms, "POST", path, document, headers=headers)
    if audit["state"] not in FINAL:
        yield from follow(terms, f"/v1/jobs/{audit['id']}", seconds=seconds)
        audit = yield from ask_json(terms, "GET", f"{path}/{audit['id']}")
    if audit["comparison"] is None:
        raise FailedError(audit)
    return Audit(audit)
