"""GET /metrics, as a Prometheus server reads it."""

import json
import math
import re
import shutil
import subprocess
import time
from http import HTTPStatus
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families
from sqlalchemy import text

from service.api.prometheus import WorkerCollector
from service.app import create_app
from service.jobs.records import JobState
from service.local.workers import Restarts, WorkerStanding
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import WorkerRow
from service.storage.tables.solutions import SweepRow
from service.storage.upkeep.statistics import BOUNDS, SETTLED_SECONDS, Statistics
from tests.support.api import STATE, SUMMARY, TestClient, finish
from tests.support.finishing import finish_success

TOP = Path(__file__).parents[3]


class Scrape:
    """What one request to /metrics tells."""

    def __init__(self, client):
        response = client.get("/metrics")
        assert response.status_code == 200
        assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
        self.families = {family.name: family for family in text_string_to_metric_families(response.text)}

    def __call__(self, name, **labels):
        samples = [sample for family in self.families.values() for sample in family.samples]
        (value,) = [s.value for s in samples if s.name == name and labels.items() <= s.labels.items()]
        return value


@pytest.fixture
def scrape(client, monkeypatch):
    # Every scrape measures anew; how often it does else is a test of its own.
    monkeypatch.setattr("service.storage.upkeep.statistics.YOUNG_SECONDS", 0.0)
    monkeypatch.setattr("service.storage.upkeep.statistics.SHARE", math.inf)
    return lambda: Scrape(client)


def submit(client, samples):
    document = {**STATE, "time": {"stop": 20, "samples": samples}}
    assert client.post("/v1/jobs", json=document).status_code == 202


def claim(jobs):
    return jobs.claim("test", lease_seconds=60.0)


def test_an_empty_installation_tells_zeros(scrape):
    told = scrape()
    assert told("polhode_database_up") == 1
    for state in ("queued", "running"):
        for kind in ("solve", "chunk", "atlas"):
            assert told("polhode_jobs", state=state, kind=kind) == 0
    assert told("polhode_oldest_queued_seconds") == 0
    assert told("polhode_attempts_total", outcome="lost") == 0
    assert told("polhode_sweep_points_total", outcome="refused") == 0
    assert told("polhode_database_bytes") > 10_000
    assert told("polhode_info", version="0.1.0") == 1
    assert told("process_resident_memory_bytes") > 0


def test_jobs_are_counted_where_they_are(client, jobs, scrape):
    for samples in (2, 3, 4):
        submit(client, samples)
    claim(jobs)
    told = scrape()
    assert told("polhode_jobs", state="queued", kind="solve") == 2
    assert told("polhode_jobs", state="running", kind="solve") == 1
    assert told("polhode_oldest_queued_seconds") > 0


def test_attempts_are_counted_by_how_they_ended(client, jobs, scrape):
    scrape()
    for samples in (2, 3, 4, 5):
        submit(client, samples)
    finish(jobs)
    jobs.finish_failure(claim(jobs), {"code": "no_motion"})
    jobs.lose(claim(jobs), "died", max_attempts=1)
    jobs.give_back(claim(jobs))
    told = scrape()
    outcomes = ("succeeded", "failed", "lost", "returned", "cancelled")
    assert [told("polhode_attempts_total", outcome=o) for o in outcomes] == [1, 1, 1, 1, 0]


def test_what_has_settled_is_counted_once(jobs, database, monkeypatch):
    statistics = Statistics(database, seen_seconds=30.0)
    monkeypatch.setattr("service.storage.upkeep.statistics.YOUNG_SECONDS", 0.0)
    monkeypatch.setattr("service.storage.upkeep.statistics.SHARE", math.inf)
    jobs.submit({"x": 1}, "digest")
    finish_success(jobs, claim(jobs), SUMMARY, dense=b"d", samples=b"s")
    for settled in (SETTLED_SECONDS, -1.0, -1.0, SETTLED_SECONDS):
        monkeypatch.setattr("service.storage.upkeep.statistics.SETTLED_SECONDS", settled)
        ended = statistics.current().ended
        assert ended.attempts == {"succeeded": 1}
        assert ended.durations["quadrature", "standard"].count == 1


def test_durations_of_jobs_come_by_method_and_tier(client, jobs, database, scrape):
    for seconds, samples in ((0.04, 2), (7.0, 3)):
        submit(client, samples)
        job = finish(jobs).job.id.replace("-", "" if database.engine.dialect.name == "sqlite" else "-")
        with database.write() as session:
            statement = text("UPDATE attempts SET started_at = ended_at - :seconds WHERE job_id = :job")
            session.execute(statement, {"seconds": seconds, "job": job})
    told = scrape()
    way = {"method": "quadrature", "tier": "standard"}
    below = {le: told("polhode_job_seconds_bucket", le=repr(le), **way) for le in BOUNDS}
    assert (below[0.025], below[0.05], below[2.5], below[10.0]) == (0, 1, 1, 2)
    assert told("polhode_job_seconds_count", **way) == 2
    # Instants are doubles near 2e9: a difference keeps 7 digits of a second.
    assert told("polhode_job_seconds_sum", **way) == pytest.approx(7.04, abs=1e-5)


def test_workers_that_are_silent_are_not_counted(database, scrape):
    with database.write() as session:
        now = session.scalar(DatabaseNow().select())
        for name, seen in (("a", now), ("b", now - 20), ("gone", now - 60)):
            session.add(
                WorkerRow(name=name, host="h", engine="local", slots=2, started_at=now - 99, seen_at=seen)
            )
    told = scrape()
    # The lease is 10 s, and three leases count as lately.
    assert told("polhode_workers", engine="local") == 2
    assert told("polhode_worker_slots", engine="local") == 4


def put_sweep(database, sweep_id, *, state="running", done=0, refused=0):
    values = {"state": state, "points": 1000, "next_index": 1000, "done": done, "refused": refused}
    with database.write() as session:
        row = session.get(SweepRow, sweep_id)
        if row is None:
            session.add(SweepRow(id=sweep_id, document={}, created_at=0.0, **values))
        else:
            for name, value in values.items():
                setattr(row, name, value)


def test_points_of_sweeps_are_counted_as_they_are_done(database, scrape):
    early, late, quick = (new_id() for _ in range(3))
    put_sweep(database, early, done=100, refused=10)
    assert scrape()("polhode_sweeps", state="running") == 1
    put_sweep(database, early, done=150, refused=11)
    put_sweep(database, late, state="queued")
    told = scrape()
    assert told("polhode_sweep_points_total", outcome="solved") == 49
    assert told("polhode_sweep_points_total", outcome="refused") == 1
    # One ends between two looks, another comes and goes.
    put_sweep(database, early, state="succeeded", done=1000, refused=11)
    put_sweep(database, quick, state="succeeded", done=5)
    for _ in range(2):
        told = scrape()
        assert told("polhode_sweep_points_total", outcome="solved") == 904
        assert told("polhode_sweep_points_total", outcome="refused") == 1
        assert told("polhode_sweeps", state="running") == 0
        assert told("polhode_sweeps", state="queued") == 1


@pytest.mark.any_database
def test_requests_are_counted_by_the_template_of_their_route(client, stored, scrape):
    client.get(f"/v1/solutions/{stored.solution_id}")
    client.get("/v1/solutions/nonsense")
    client.get("/nowhere/at/all")
    client.request("BREW", "/coffee")
    told, count = scrape(), "polhode_http_request_seconds_count"
    solution = "/v1/solutions/{solution_id}"
    assert told(count, method="GET", route=solution, status="200") == 1
    assert told(count, method="GET", route=solution, status="404") == 1
    assert told(count, method="GET", route="none", status="404") == 1
    assert told(count, method="other", route="none") == 1
    assert told(count, method="POST", route="/v1/jobs", status="202") == 1


@pytest.mark.any_database
def test_a_fault_of_ours_is_counted_as_one(client, monkeypatch, scrape):
    monkeypatch.setattr("service.api.routes.installation.json_response", lambda _: 1 / 0)
    assert client.get("/livez").status_code == 500
    assert scrape()("polhode_http_request_seconds_count", route="/livez", status="500") == 1


def test_without_the_database_the_process_still_tells_of_itself(client, app, monkeypatch, scrape):
    broken = Statistics(Database("sqlite:////missing/folder/x.db"), seen_seconds=30.0)
    monkeypatch.setattr(app.state.resources.metrics._database, "_statistics", broken)
    told = scrape()
    assert told("polhode_database_up") == 0
    assert "polhode_jobs" not in told.families
    assert scrape()("polhode_http_request_seconds_count", route="/metrics") == 1


@pytest.mark.any_database
def test_what_was_measured_a_moment_ago_is_not_measured_again(jobs, database):
    statistics = Statistics(database, seen_seconds=30.0)
    before = statistics.current()
    jobs.submit({"x": 1}, "digest")
    assert statistics.current() is before
    assert not before.live


@pytest.mark.any_database
def test_costly_measurements_are_rare(database, monkeypatch):
    statistics = Statistics(database, seen_seconds=30.0)

    def at(*moments):
        # Only for the module under test: whatever else runs in this process needs the real time.
        clock = SimpleNamespace(time=time.time, monotonic=iter(moments).__next__)
        monkeypatch.setattr("service.storage.upkeep.statistics.time", clock)

    at(0.0, 3.0)  # the measurement takes 3 s: for a minute it is not repeated
    first = statistics.current()
    at(62.9)
    assert statistics.current() is first
    at(63.1, 63.1, 63.1)  # its age, and a measurement that begins and ends
    assert statistics.current() is not first


@pytest.mark.any_database
def test_two_applications_have_metrics_of_their_own(app, client):
    with TestClient(create_app(Settings(database_url=app.state.resources.settings.database_url))) as other:
        client.get("/livez")
        Scrape(client)("polhode_http_request_seconds_count", route="/livez")
        assert "/livez" not in other.get("/metrics").text


@pytest.mark.any_database
def test_the_documentation_names_every_metric_and_no_other(client, stored, scrape):
    client.get("/livez")
    page = (TOP / "docs" / "operations.md").read_text(encoding="utf-8")
    rows = [
        line.partition("|")[2].partition("|")[0]
        for line in page.splitlines()
        if line.startswith("| `polhode_")
    ]
    documented = {name for row in rows for name in re.findall(r"polhode_\w+", row)}
    # Of a histogram the client library also tells since when it counts.
    told = {
        name for name in scrape().families if name.startswith("polhode_") and not name.endswith("_created")
    }
    # The application of the tests has no worker process of its own.
    told |= {metric.name for metric in WorkerCollector(lambda: WorkerStanding(Restarts())).collect()}
    # The parser calls families of counters by their names without the ending.
    assert {name.removesuffix("_total") for name in documented} == told


def test_the_states_that_are_counted_are_those_that_end(scrape):
    told = {s.labels["state"] for s in scrape().families["polhode_jobs"].samples}
    assert told == {JobState.QUEUED.value, JobState.RUNNING.value}


def expressions(file):
    """Return all expressions of the rules, or of the panels of the dashboard."""
    document = yaml.safe_load((TOP / "docker" / file).read_text(encoding="utf-8"))
    if "groups" in document:
        return [rule["expr"] for group in document["groups"] for rule in group["rules"]]
    return [target["expr"] for panel in document["panels"] for target in panel["targets"]]


@pytest.mark.any_database
@pytest.mark.parametrize("file", ["alerts.yaml", "grafana.json"])
def test_alerts_and_panels_ask_for_metrics_labels_and_values_that_there_are(
    client, stored, database, scrape, file
):
    client.get("/livez")
    with database.write() as session:
        now = session.scalar(DatabaseNow().select())
        session.add(WorkerRow(name="a", host="h", engine="local", slots=2, started_at=now, seen_at=now))
    families = [
        *scrape().families.values(),
        *WorkerCollector(lambda: WorkerStanding(Restarts())).collect(),
    ]
    samples = [sample for family in families for sample in family.samples]
    assert {sample.name for sample in samples} > {"polhode_job_seconds_bucket", "polhode_workers"}
    asked = expressions(file)
    assert len(asked) > 9
    for expression in asked:
        names = set(re.findall(r"\b(?:polhode|process)_\w+", expression))
        assert names or expression.startswith("up{")
        found = [sample for sample in samples if sample.name in names]
        assert {sample.name for sample in found} == names, expression
        # Prometheus adds the labels of what it scrapes, and a target's own status.
        values = {"job": {"polhode"}, "instance": set()}
        for sample in found:
            for label, value in sample.labels.items():
                values.setdefault(label, set()).add(value)
        for group in re.findall(r"\b(?:by|without) \(([^)]*)\)", expression):
            assert set(group.split(", ")) <= set(values), expression
        for label, value in re.findall(r'(\w+)="([^"]*)"', expression):
            # There is a sample of a status once there was such an answer.
            assert value in values[label] or (label == "status" and HTTPStatus(int(value))), expression


def test_panels_do_not_overlap_and_every_one_has_a_unit_and_a_legend():
    panels = json.loads((TOP / "docker" / "grafana.json").read_text(encoding="utf-8"))["panels"]
    cells = [
        (panel["gridPos"]["x"] + i, panel["gridPos"]["y"] + j)
        for panel in panels
        for i in range(panel["gridPos"]["w"])
        for j in range(panel["gridPos"]["h"])
    ]
    assert len(cells) == len(set(cells))
    assert {x for x, _ in cells} == set(range(24))  # the width of a dashboard
    assert len({panel["id"] for panel in panels}) == len(panels)
    for panel in panels:
        assert panel["fieldConfig"]["defaults"]["unit"]
        assert all(target["legendFormat"] for target in panel["targets"])


PROMTOOL = shutil.which("promtool")
QUIET = """
evaluation_interval: 1m
rule_files: [{alerts}]
tests:
  - interval: 1m
    input_series:
      - {{series: 'polhode_jobs{{state="queued", kind="solve"}}', values: '1x20'}}
      - {{series: 'polhode_workers{{engine="local"}}', values: '{workers}'}}
      - {{series: 'polhode_attempts_total{{outcome="lost"}}', values: '{lost}'}}
    alert_rule_test:
      - {{eval_time: 18m, alertname: PolhodeNoWorkers, exp_alerts: {no_workers}}}
      - {{eval_time: 18m, alertname: PolhodeWorkersDie, exp_alerts: {dying}}}
"""


@pytest.mark.skipif(PROMTOOL is None, reason="not installed: apt-get install prometheus")
@pytest.mark.parametrize("is_well", [True, False])
def test_prometheus_reads_the_rules_and_alerts_when_it_should(tmp_path, is_well):
    alerts = TOP / "docker" / "alerts.yaml"
    rules = yaml.safe_load(alerts.read_text(encoding="utf-8"))["groups"][0]["rules"]
    said = {rule["alert"]: rule["annotations"] for rule in rules}

    def expected(name, severity):
        alert = {"exp_labels": {"severity": severity}, "exp_annotations": said[name]}
        return json.dumps([] if is_well else [alert])

    # Of no workers there is no sample. Each minute one attempt is lost: 15 in a quarter of an hour.
    text = QUIET.format(
        alerts=alerts,
        workers="1x20" if is_well else "_x20",
        lost="0x20" if is_well else "0+1x20",
        no_workers=expected("PolhodeNoWorkers", "page"),
        dying=expected("PolhodeWorkersDie", "ticket"),
    )
    (tmp_path / "test.yaml").write_text(text, encoding="utf-8")
    done = subprocess.run([PROMTOOL, "test", "rules", tmp_path / "test.yaml"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    config = (TOP / "docker" / "prometheus.yaml").read_text(encoding="utf-8")
    (tmp_path / "key").touch()
    config = config.replace("/etc/prometheus/polhode.key", str(tmp_path / "key"))
    (tmp_path / "prometheus.yaml").write_text(config, encoding="utf-8")
    shutil.copy(alerts, tmp_path)
    checked = subprocess.run([PROMTOOL, "check", "config", tmp_path / "prometheus.yaml"], capture_output=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
