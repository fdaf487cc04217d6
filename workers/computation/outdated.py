"""Lists stored solutions of earlier versions in windows next to a place where p² is infinite.

Versions before COLLISIONS took some such places for zeros of p², or passed them: what they said of a window
that ends there is not to be believed. Whether a solution is in such a window is found anew.
"""

from collections.abc import Iterator, Mapping

from sqlalchemy import select

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.windows import choose_window, find_windows
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.storage.database.database import Database
from service.storage.inspection.inspect import EXAMPLES, Finding
from service.storage.tables.solutions import SolutionRow

COLLISIONS = 10
"""The first numerics version that proves where p² is infinite."""
_PAGE = 500


def check_windows(database: Database) -> Finding:
    """Return the finding about solutions of earlier versions in windows that end where p² is infinite."""
    broken, examples = 0, list[str]()
    for solution, problem in _earlier(database):
        doubt = _doubt_of(problem)
        if doubt is not None:
            broken += 1
            if len(examples) < EXAMPLES:
                examples.append(f"{solution}: {doubt}")
    says = f"no solution of numerics before {COLLISIONS} is in a window next to a place where p² is infinite"
    return Finding("windows_at_infinities", says, broken, tuple(examples), is_warning=True)


def _earlier(database: Database) -> Iterator[tuple[str, Problem]]:
    """Yield the planar motions that earlier versions solved, with the ids of their solutions."""
    columns = SolutionRow.id, SolutionRow.problem, SolutionRow.summary
    last = ""
    while True:
        page = select(*columns).order_by(SolutionRow.id).limit(_PAGE)
        with database.read() as session:
            rows = session.execute(page.where(SolutionRow.id > last) if last else page).all()
        if not rows:
            return
        last = rows[-1][0]
        for solution, document, summary in rows:
            provenance = summary.get("provenance")
            if isinstance(provenance, Mapping) and provenance.get("numerics", 0) >= COLLISIONS:
                continue
            try:
                problem = read_problem(document)
            except InvalidProblemError:
                # A problem of another version of documents is another check's.
                continue
            if isinstance(problem.motion, PlanarMotion):
                yield solution, problem


def _doubt_of(problem: Problem) -> str | None:
    """Return what is the matter with the window of a motion, None if nothing is."""
    motion, potential = problem.motion, problem.potential
    assert isinstance(motion, PlanarMotion)
    part = potential if potential.has_formula else potential.formula_part(motion.sign_of_g1, motion.g3_sign)
    if part is None or not vanishing_parts(tight_form(part.tape)):
        return None
    try:
        window = choose_window(find_windows(problem.body, potential, motion), motion)
    except DynamicsError as refusal:
        return refusal.code
    ends = {
        end
        for arc in window.arcs
        for v, end in ((arc.lower, arc.lower_end), (arc.upper, arc.upper_end))
        if not v.sin().contains(0)
    }
    return f"window {window.index} ends in a collision" if "collision" in ends else None
