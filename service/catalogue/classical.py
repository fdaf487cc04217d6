"""The classical cases of the heavy body, each with a problem that runs as it stands."""

from service.dynamics.classical.catalogue import CASES
from service.dynamics.classical.protocol import ClassicalCase
from service.schemas.replies.installation import ClassicalOut


def classical() -> list[ClassicalOut]:
    """Return the cases in the order of the table of the paper, and the one whose text was not obtained."""
    return [*(_row(case) for case in CASES.values()), _not_obtained()]


def example_of(case: ClassicalCase) -> dict[str, object]:
    """Return a problem document: two periods, or ten units of time where the motion does not close."""
    given: dict[str, object] = dict(case.example)
    body = {name: given.pop(name) for name in "ABC" if name in given}
    centre = {name: given.pop(name) for name in "abc" if name in given}
    potential: dict[str, object] = {"type": "gravity", **centre}
    motion: dict[str, object] = {"type": "classical", "case": case.name, **given}
    time: dict[str, object] = {"periods": 2} if case.form == "loop" else {"stop": 10}
    return {
        "body": body,
        "potential": potential,
        "motion": motion,
        "time": {**time, "samples": 401},
        "outputs": ["gamma", "omega", "invariants"],
    }


def _row(case: ClassicalCase) -> ClassicalOut:
    about = case.about
    return ClassicalOut(
        case=case.name,
        title=about.title,
        author=about.author,
        year=about.year,
        conditions=list(about.conditions),
        real=about.real,
        parameters=case.fields,
        relations=list(about.relations),
        functions=about.functions,
        periodic=case.form == "loop",
        stability=about.stability,
        source=about.source,
        example=example_of(case),
    )


def _not_obtained() -> ClassicalOut:
    return ClassicalOut(
        case="dokshevich_1970",
        title="A new particular solution of the equations of motion of a gyroscope having a fixed point",
        author="A. I. Dokshevich",
        year=1970,
        conditions=[],
        real="not known: no text of the paper was obtained",
        parameters={},
        relations=[],
        functions="not known; elliptic_x_minus_k_over_x may be this case, which nobody has checked",
        periodic=None,
        stability="not known",
        source="not_obtained",
        example=None,
    )
