"""Whatever has an id: jobs, motions and sweeps."""

from polhode.errors import MissingError
from polhode.jobs import Job
from polhode.motions import Motion
from polhode.sweeps import Sweep
from polhode.transport.carriers import CarrierT
from polhode.transport.exchange import ask_json
from polhode.transport.steps import Operation

Thing = Job[CarrierT] | Motion[CarrierT] | Sweep[CarrierT]


def thing_of(carrier: CarrierT, thing_id: str) -> Operation[Thing[CarrierT]]:
    """Return what has an id.

    Raises
    ------
    MissingError
        There is no job, no solution and no sweep of this id.
    """
    for kind in (Job, Motion):
        try:
            path = f"/v1/{'jobs' if kind is Job else 'solutions'}/{thing_id}"
            return kind(carrier, (yield from ask_json(carrier.terms, "GET", path)))
        except MissingError:
            continue
    try:
        return Sweep(carrier, (yield from ask_json(carrier.terms, "GET", f"/v1/sweeps/{thing_id}")))
    except MissingError as fault:
        told = {**fault.document, "detail": f"no job, solution or sweep has the id {thing_id}"}
        raise MissingError(fault.status, told) from None


def path_of(thing: Thing[CarrierT]) -> str:
    """Return where the service has it."""
    kind = "jobs" if isinstance(thing, Job) else "sweeps" if isinstance(thing, Sweep) else "solutions"
    return f"/v1/{kind}/{thing.id}"
