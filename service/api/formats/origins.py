"""Says where solutions come from: citations (BibTeX, Citation File Format 1.2.0), and PROV-JSON.

The Citation File Format is at https://citation-file-format.github.io. PROV-JSON, here of a solution or of
the points of a sweep, is a member submission to the W3C of 2013; PROV-DM, its model, a recommendation.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from urllib.parse import quote

from service.jobs.records import Attempt, AttemptOutcome, SweepRecord
from service.schemas.reading.documents import Part, instant_text
from service.schemas.replies.solution import ProvenanceGraphOut, Records
from service.storage.solutions.solution_store import SolutionOrigin

PAPER = "New solvable problems in the dynamics of a rigid body about a fixed point in a potential field"
"""Title of the paper by H. M. Yehia that the method is from."""
PROGRAM = "The polhode authors"
CITATIONS: Mapping[str, str] = {"bibtex": "application/x-bibtex", "cff": "application/yaml"}
"""Media types by the names of the formats."""

_SPECIAL = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
}


@dataclass(frozen=True, slots=True)
class Cited:
    """The facts that identify a solution to a reader."""

    id: str
    digest: str
    """SHA-256 of the problem and the numerics version."""
    title: str
    made: date
    version: str
    numerics: int


def title_of(problem: Part) -> str:
    """Return what the solution of a problem document is, in words, with its moments and its potential."""
    body, motion = problem["body"], problem["motion"]
    potential = problem["potential"]
    kinds = {"planar": "Planar motion", "state": "Motion from a given state"}
    kind = kinds.get(str(motion["type"])) or f"Classical motion ({motion.get('case')})"
    moments = ", ".join(f"{name} = {body[name]}" for name in ("A", "B", "C") if body.get(name) is not None)
    force = f"V = {formula}" if (formula := potential.get("expression")) else f"potential {potential['type']}"
    return f"{kind} of a rigid body about a fixed point, {moments}, {force}"


def bibtex(cited: Cited) -> str:
    """Return an entry for the solution, and one for the paper that the method is from."""
    solution = {
        "author": f"{{{PROGRAM}}}",
        "title": f"{{{_escaped(cited.title)}}}",
        "year": str(cited.made.year),
        "month": str(cited.made.month),
        "version": _escaped(cited.version),
        "note": f"Solution {cited.id}, computed with numerics {cited.numerics}; "
        f"SHA-256 of the problem {cited.digest}",
    }
    paper = {"author": "Yehia, Hamad M.", "title": f"{{{PAPER}}}", "note": "Manuscript"}
    return "\n".join(
        [*_entry(f"polhode-{cited.id}", solution), "", *_entry("yehia-new-solvable-problems", paper), ""]
    )


def _entry(key: str, fields: Mapping[str, str]) -> Iterator[str]:
    yield f"@misc{{{key},"
    yield from (f"  {name} = {{{value}}}," for name, value in fields.items())
    yield "}"


def _escaped(text: str) -> str:
    """Return text that TeX prints as it is, on one line."""
    return "".join(_SPECIAL.get(character, character) for character in " ".join(text.split()))


def cff(cited: Cited) -> str:
    """Return a citation file for the solution; every value is a JSON string, which YAML reads as text."""
    lines = [
        ("cff-version", "1.2.0"),
        ("message", "Please cite this solution as below."),
        ("type", "dataset"),
        ("title", cited.title),
        ("version", cited.version),
        ("date-released", cited.made.isoformat()),
    ]
    written = [f"{name}: {json.dumps(value, ensure_ascii=False)}" for name, value in lines]
    written += ["authors:", f"  - name: {json.dumps(PROGRAM)}", "identifiers:"]
    written += _identifier(f"urn:uuid:{cited.id}", "The solution.")
    written += _identifier(f"sha256:{cited.digest}", f"The problem, with numerics {cited.numerics}.")
    written += ["references:", "  - type: article", f"    title: {json.dumps(PAPER)}", "    authors:"]
    return "\n".join([*written, '      - family-names: "Yehia"', '        given-names: "Hamad M."', ""])


def _identifier(value: str, description: str) -> Sequence[str]:
    return "  - type: other", f"    value: {json.dumps(value)}", f"    description: {json.dumps(description)}"


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
