"""Writes the origin of a solution, or of the points of a sweep, as PROV-JSON.

PROV-JSON is a member submission to the W3C of 2013; PROV-DM, its model, a recommendation.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from urllib.parse import quote

from service.jobs.records import Attempt, AttemptOutcome, SweepRecord
from service.schemas.reading.documents import Part, instant_text
from service.schemas.replies.solution import ProvenanceGraphOut, Records
from service.storage.solutions.origin import SolutionOrigin

PREFIX = {"polhode": "urn:polhode:provenance:"}
_SOFTWARE = {"$": "prov:SoftwareAgent", "type": "prov:QUALIFIED_NAME"}


@dataclass(slots=True)
class _Graph:
    entities: Records = field(default_factory=dict)
    activities: Records = field(default_factory=dict)
    agents: Records = field(default_factory=dict)
    used: Records = field(default_factory=dict)
    generated: Records = field(default_factory=dict)
    derived: Records = field(default_factory=dict)
    associated: Records = field(default_factory=dict)

    def use(self, activity: str, entity: str) -> None:
        _relate(self.used, "use", {"prov:activity": activity, "prov:entity": entity})

    def generate(self, entity: str, activity: str) -> None:
        _relate(self.generated, "generation", {"prov:entity": entity, "prov:activity": activity})

    def derive(self, entity: str, source: str) -> None:
        made = {"prov:generatedEntity": entity, "prov:usedEntity": source}
        _relate(self.derived, "derivation", made)

    def associate(self, activity: str, agent: str) -> None:
        _relate(self.associated, "association", {"prov:activity": activity, "prov:agent": agent})

    def compute_with(self, activity: str, agents: Iterable[tuple[str, str]]) -> None:
        """Associate a computation with programs, each an identifier and a name."""
        for agent, name in agents:
            self.agents[agent] = {"prov:type": _SOFTWARE, "prov:label": name}
            self.associate(activity, agent)

    def document(self) -> ProvenanceGraphOut:
        """Return it as it is answered."""
        return ProvenanceGraphOut(
            prefix=PREFIX,
            entity=self.entities,
            activity=self.activities,
            agent=self.agents,
            used=self.used,
            wasGeneratedBy=self.generated,
            wasDerivedFrom=self.derived,
            wasAssociatedWith=self.associated,
        )


def provenance_graph(origin: SolutionOrigin) -> ProvenanceGraphOut:
    """Return the problem, what was done with it, by whom and with what, and the solution."""
    graph = _Graph()
    summary = origin.solution.summary
    provenance = summary.get("provenance")
    versions = dict(provenance) if isinstance(provenance, Mapping) else {}
    problem, solution = _name("problem", origin.digest), _name("solution", origin.solution.id)
    graph.entities[problem] = {
        "prov:type": "polhode:Problem",
        # A string, since attributes of PROV have no structure.
        "prov:value": json.dumps(origin.solution.problem),
        "polhode:digest": origin.digest,
    }
    graph.entities[solution] = {
        "prov:type": "polhode:Solution",
        "polhode:created_at": instant_text(origin.solution.created_at),
        **{
            f"polhode:{name}": summary[name]
            for name in ("method", "tier", "error")
            if summary.get(name) is not None
        },
    }
    graph.derive(solution, problem)
    examination = _examine(graph, origin, problem)
    for attempt in origin.attempts:
        activity = _attempt(graph, origin, attempt, versions)
        graph.use(activity, problem)
        if examination is not None:
            graph.use(activity, examination)
        if attempt.outcome is AttemptOutcome.SUCCEEDED:
            graph.generate(solution, activity)
            graph.compute_with(activity, _software(versions))
    return graph.document()


def graph_of_points(record: SweepRecord) -> ProvenanceGraphOut:
    """Return a sweep, its points, and what computed them: an activity for all hosts that are alike."""
    graph = _Graph()
    sweep, points = _name("sweep", record.id), _name("points", record.id)
    graph.entities[sweep] = {"prov:type": "polhode:Sweep", "prov:value": json.dumps(record.document)}
    graph.entities[points] = {
        "prov:type": "polhode:Points",
        "polhode:points": record.points,
        "polhode:done": record.done,
    }
    graph.derive(points, sweep)
    for number, provenance in enumerate(record.provenances):
        activity, hosts = _name("sweep", record.id, "computation", str(number)), provenance["hosts"]
        graph.activities[activity] = {"prov:type": "polhode:Computation", **_machine(provenance)}
        graph.use(activity, sweep)
        graph.generate(points, activity)
        graph.compute_with(activity, [(_name("host", host), host) for host in hosts])
        graph.compute_with(activity, _software(provenance))
    return graph.document()


def _examine(graph: _Graph, origin: SolutionOrigin, problem: str) -> str | None:
    """Add the examination that found where the motion exists, if its result was kept; return that."""
    if origin.examination is None:
        return None
    windows = _name("windows", origin.examination)
    activity = _name("examination", origin.examination)
    graph.entities[windows] = {"prov:type": "polhode:Windows", "polhode:key": origin.examination}
    attributes: dict[str, object] = {"prov:type": "polhode:Examination"}
    if origin.examined_seconds is not None:
        attributes["polhode:seconds"] = origin.examined_seconds
    graph.activities[activity] = attributes
    graph.use(activity, problem)
    graph.generate(windows, activity)
    graph.derive(windows, problem)
    return windows


def _attempt(graph: _Graph, origin: SolutionOrigin, attempt: Attempt, versions: Part) -> str:
    activity = _name("job", origin.solution.job_id, "attempt", str(attempt.number))
    attributes: dict[str, object] = {
        "prov:type": "polhode:Computation",
        "prov:startTime": instant_text(attempt.started_at),
    }
    if attempt.ended_at is not None:
        attributes["prov:endTime"] = instant_text(attempt.ended_at)
    if attempt.outcome is not None:
        attributes["polhode:outcome"] = attempt.outcome.value
    if attempt.outcome is AttemptOutcome.SUCCEEDED:
        attributes |= _machine(versions)
        cost = origin.solution.summary.get("cost")
        if isinstance(cost, Mapping) and "compute_seconds" in cost:
            attributes["polhode:compute_seconds"] = cost["compute_seconds"]
    elif attempt.detail is not None:
        attributes["polhode:reason"] = attempt.detail
    graph.activities[activity] = attributes
    graph.compute_with(activity, [(_name("worker", attempt.worker), attempt.worker)])
    return activity


def _machine(provenance: Part) -> dict[str, object]:
    names = ("numerics", "processor", "threads")
    return {f"polhode:{name}": provenance[name] for name in names if provenance.get(name)}


def _software(versions: Part) -> Iterator[tuple[str, str]]:
    """Yield the identifier and the name, with its version, of polhode and of each library."""
    named = [f"polhode {versions['version']}"] if "version" in versions else []
    if versions.get("libraries"):
        named += str(versions["libraries"]).split(", ")
    for name in named:
        yield _name("software", name), name


def _relate(relations: Records, name: str, related: Part) -> None:
    relations[f"_:{name}{len(relations) + 1}"] = dict(related)


def _name(*parts: str) -> str:
    """Return a qualified name; what such a name cannot hold is escaped as in a URL."""
    return "polhode:" + "/".join(quote(part, safe="") for part in parts)
