"""The recipe with nginx in docs/operations.md, word for word but for its ports and its certificate."""

import http.client
import json
import re
import shutil
import signal
import socket
import ssl
import subprocess
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from service.storage.database.migration import migrate
from tests.abuse.readers import ATTACKS
from tests.support.api import PLANAR
from tests.support.databases import url_of
from tests.support.serving import Service, serving
from tests.support.sweeps import store_points
from tests.workers.processes import wait_until

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin")
OPENSSL = shutil.which("openssl")
pytestmark = pytest.mark.skipif(
    NGINX is None or OPENSSL is None, reason="not installed: apt-get install nginx openssl"
)
OPERATIONS = Path(__file__).parents[2] / "docs" / "operations.md"
POINTS = 300_000


def recipe(folder: Path, service: Service, port: int) -> str:
    """Return a configuration with the site of the documentation, on a port of its own."""
    text = OPERATIONS.read_text(encoding="utf-8")
    found = re.search(r"^```nginx\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    assert found is not None
    site, upstream = found[1], service.address.removeprefix("http://")
    for written, here in (
        ("server 127.0.0.1:8000;", f"server {upstream};"),
        ("listen 443 ssl;", f"listen 127.0.0.1:{port} ssl;"),
        ("/etc/ssl/polhode.pem", str(folder / "polhode.pem")),
        ("/etc/ssl/polhode.key", str(folder / "polhode.key")),
    ):
        assert site.count(written) == 1
        site = site.replace(written, here)
    kept = "".join(
        f"{kind}_temp_path {folder / kind};\n"
        for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    head = f"daemon off; master_process off; pid {folder / 'pid'}; error_log stderr;\nevents {{}}\n"
    return f"{head}http {{\naccess_log off;\n{kept}{site}}}\n"


@contextmanager
def proxied(folder: Path, service: Service) -> Iterator[int]:
    """Run nginx in front of a service; yield its port."""
    assert NGINX is not None
    assert OPENSSL is not None
    folder.mkdir()
    subject = ("-subj", "/CN=localhost", "-days", "1", "-nodes", "-newkey", "rsa:2048")
    files = ("-keyout", folder / "polhode.key", "-out", folder / "polhode.pem")
    subprocess.run([OPENSSL, "req", "-x509", *subject, *files], check=True, capture_output=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    (folder / "nginx.conf").write_text(recipe(folder, service, port), encoding="utf-8")
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen([NGINX, "-p", folder, "-c", folder / "nginx.conf"], stderr=log)
    try:

        def answers() -> bool:
            assert process.poll() is None, (folder / "log").read_text()
            try:
                return ask(port, "GET", "/livez")[0] == 200
            except OSError:
                return False

        wait_until(answers)
        yield port
    finally:
        process.terminate()
        process.wait(timeout=60)


def connection(port: int) -> http.client.HTTPSConnection:
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE  # it is signed by nobody
    return http.client.HTTPSConnection("127.0.0.1", port, timeout=120, context=trusting)


def ask(
    port: int, method: str, path: str, document: object = None, **headers: str
) -> tuple[int, dict, bytes]:
    body = None if document is None else json.dumps(document)
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(connection(port)) as client:
        client.request(method, path, body=body, headers={"Content-Type": "application/json", **sent})
        answer = client.getresponse()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()


@pytest.fixture(scope="module")
def behind(tmp_path_factory) -> Iterator[tuple[Service, int, str, str]]:
    """A service, the port of nginx in front of it, a solution and a sweep."""
    folder = tmp_path_factory.mktemp("nginx")
    url = url_of(folder / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, POINTS)
    with (
        serving(folder, POLHODE_DATABASE_URL=url) as service,
        proxied(folder / "nginx", service) as port,
    ):
        _, _, job = ask(port, "POST", "/v1/jobs", PLANAR, Prefer="wait=60")
        yield service, port, json.loads(job)["solution"], sweep_id


def test_answers_are_those_of_the_service_large_and_tagged_ones_too(behind):
    service, port, solution, _ = behind
    for path in (f"/v1/solutions/{solution}", ATTACKS["trajectories as CSV"].path.format(solution=solution)):
        direct = service.call("GET", path).document if "trajectory" not in path else None
        status, headers, content = ask(port, "GET", path)
        assert status == 200
        assert direct is None or json.loads(content) == direct
        assert content.count(b"\r\n") == (0 if direct else 100_001)
        assert ask(port, "GET", path, If_None_Match=headers["etag"])[0] == 304


def test_refusals_are_the_documents_of_the_service(behind):
    _, port, _, _ = behind
    status, headers, content = ask(port, "POST", "/v1/jobs", ["x" * 1_100_000])
    assert (status, headers["content-type"]) == (413, "application/problem+json")
    assert json.loads(content)["type"].endswith(":body_too_large")


def test_pages_of_its_origin_may_send_requests_and_others_may_not(behind):
    _, port, _, _ = behind
    own, other = f"https://127.0.0.1:{port}", "https://elsewhere.example"
    assert ask(port, "POST", "/v1/jobs", PLANAR, Origin=own)[0] == 202
    assert ask(port, "POST", "/v1/jobs", PLANAR, Origin=other)[0] == 403


def test_events_are_sent_on_at_once(behind):
    _, port, _, _ = behind
    job = json.loads(
        ask(port, "POST", "/v1/jobs", {**PLANAR, "motion": {"type": "planar", "lambda": "3/4"}})[2]
    )
    with closing(connection(port)) as client:
        client.request("GET", f"/v1/jobs/{job['id']}/events")
        answer = client.getresponse()
        assert answer.getheader("Content-Type").startswith("text/event-stream")
        told = b""
        # The stream goes on: what has come without its end was not kept back.
        while b"succeeded" not in told:
            line = answer.readline()
            assert line, told
            told += line


def test_an_answer_that_breaks_off_is_no_answer_through_nginx_either(tmp_path):
    url = url_of(tmp_path / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, POINTS)
    with (
        serving(tmp_path, workers=0, POLHODE_DATABASE_URL=url) as service,
        proxied(tmp_path / "nginx", service) as port,
        closing(connection(port)) as client,
    ):
        client.request("GET", f"/v1/sweeps/{sweep_id}/points?format=csv")
        answer = client.getresponse()
        assert answer.status == 200
        answer.read(1000)
        service.process.send_signal(signal.SIGKILL)
        with pytest.raises((http.client.IncompleteRead, OSError)):
            answer.read()
