"""The sites of nginx and Caddy in docker/, word for word but for their addresses and their certificates."""

import http.client
import json
import os
import re
import shutil
import signal
import ssl
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from service.storage.database.migration import migrate
from tests.abuse.readers import ATTACKS
from tests.support.api import PLANAR
from tests.support.databases import url_of
from tests.support.serving import Service, free_port, serving
from tests.support.sweeps import store_points
from tests.support.waiting import wait_until

PATH = f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin"
PROXIES = {name: shutil.which(name, path=PATH) for name in ("nginx", "caddy")}
OPENSSL = shutil.which("openssl")
DOCKER = Path(__file__).parents[2] / "docker"
PREFIX = "/polhode"
POINTS = 300_000
each_proxy = pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=pytest.mark.skipif(
                not (program and OPENSSL), reason=f"not installed: apt-get install {name} openssl"
            ),
        )
        for name, program in PROXIES.items()
    ],
    scope="module",
)


def written_here(name: str, changes: Mapping[str, str]) -> str:
    """Return a file of the kit with what is of this machine in place of what is of its reader's."""
    text = (DOCKER / name).read_text(encoding="utf-8")
    for written, here in changes.items():
        assert text.count(written) == 1
        text = text.replace(written, here)
    return text


def nginx_command(folder: Path, upstream: str, port: int) -> list[str]:
    site = written_here(
        "nginx.conf",
        {
            "server 127.0.0.1:8000;": f"server {upstream};",
            "listen 443 ssl;": f"listen 127.0.0.1:{port} ssl;",
            "/etc/ssl/polhode.pem": str(folder / "polhode.pem"),
            "/etc/ssl/polhode.key": str(folder / "polhode.key"),
        },
    )
    kept = "".join(
        f"{kind}_temp_path {folder / kind};\n"
        for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    head = f"daemon off; master_process off; pid {folder / 'pid'}; error_log stderr;\nevents {{}}\n"
    text = f"{head}http {{\naccess_log off;\n{kept}{site}}}\n"
    (folder / "nginx.conf").write_text(text, encoding="utf-8")
    return ["-p", str(folder), "-c", str(folder / "nginx.conf")]


def caddy_command(folder: Path, upstream: str, port: int) -> list[str]:
    certificate = f"tls {folder}/polhode.pem {folder}/polhode.key"
    site = written_here(
        "Caddyfile",
        {
            # Its own certificate takes the place of one that Caddy would ask for.
            "\npolhode.example {": f"\nhttps://127.0.0.1:{port} {{\n{certificate}\n",
            "127.0.0.1:8000 {": f"{upstream} {{",
        },
    )
    (folder / "Caddyfile").write_text(f"{{\nadmin off\nauto_https off\n}}\n{site}", encoding="utf-8")
    return ["run", "--config", str(folder / "Caddyfile"), "--adapter", "caddyfile"]


def version_of_caddy() -> tuple[int, ...]:
    assert PROXIES["caddy"] is not None
    said = subprocess.run([PROXIES["caddy"], "version"], capture_output=True, text=True, check=True).stdout
    return tuple(map(int, re.match(r"v?(\d+)\.(\d+)", said).groups()))


COMMANDS = {"nginx": nginx_command, "caddy": caddy_command}


@contextmanager
def proxied(name: str, folder: Path, service: Service) -> Iterator[int]:
    """Run a proxy in front of a service; yield its port."""
    program = PROXIES[name]
    assert program is not None
    assert OPENSSL is not None
    folder.mkdir()
    names = ("-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1")
    subject = (*names, "-days", "1", "-nodes", "-newkey", "rsa:2048")
    files = ("-keyout", folder / "polhode.key", "-out", folder / "polhode.pem")
    subprocess.run([OPENSSL, "req", "-x509", *subject, *files], check=True, capture_output=True)
    port = free_port()
    options = COMMANDS[name](folder, service.address.removeprefix("http://"), port)
    with (folder / "log").open("wb") as log:
        own = {"HOME": str(folder), "XDG_DATA_HOME": str(folder), "XDG_CONFIG_HOME": str(folder)}
        process = subprocess.Popen([program, *options], stderr=log, env={**os.environ, **own})
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
        client.request(method, PREFIX + path, body=body, headers={"Content-Type": "application/json", **sent})
        answer = client.getresponse()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()


@pytest.fixture(scope="module")
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def behind(name: str, tmp_path_factory) -> Iterator[tuple[Service, int, str, str]]:
    """A service, the port of a proxy in front of it, a solution and a sweep."""
    folder = tmp_path_factory.mktemp(name)
    url = url_of(folder / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, POINTS)
    with (
        serving(folder, POLHODE_DATABASE_URL=url) as service,
        proxied(name, folder / "proxy", service) as port,
    ):
        _, _, job = ask(port, "POST", "/v1/jobs", PLANAR, Prefer="wait=60")
        yield service, port, json.loads(job)["solution"], sweep_id


@each_proxy
def test_the_prefix_alone_leads_to_the_page_whose_links_stay_below_it(behind):
    _, port, _, _ = behind
    with closing(connection(port)) as client:
        client.request("GET", PREFIX)
        answer = client.getresponse()
        assert (answer.status, answer.getheader("Location").endswith(f"{PREFIX}/")) == (308, True)
    status, _, page = ask(port, "GET", "/")
    assert status == 200
    links = re.findall(rb'(?:href|src)="([^"#]+)"', page)
    assert links
    assert [link for link in links if link.startswith(b"/")] == []
    for link in links:
        if not link.startswith((b"http", b"data:")):
            assert ask(port, "GET", f"/{link.decode().removeprefix('./')}")[0] == 200, link


@each_proxy
def test_answers_are_those_of_the_service_large_and_tagged_ones_too(behind):
    service, port, solution, _ = behind
    trajectory = ATTACKS["trajectories as CSV"].path.format(solution=solution, samples=100_000)
    for path in (f"/v1/solutions/{solution}", trajectory):
        direct = service.call("GET", path).document if "trajectory" not in path else None
        status, headers, content = ask(port, "GET", path)
        assert status == 200
        assert direct is None or json.loads(content) == direct
        assert content.count(b"\r\n") == (0 if direct else 100_001)
        assert ask(port, "GET", path, If_None_Match=headers["etag"])[0] == 304


@each_proxy
def test_refusals_are_the_documents_of_the_service(behind):
    _, port, _, _ = behind
    status, headers, content = ask(port, "POST", "/v1/jobs", ["x" * 1_100_000])
    assert (status, headers["content-type"]) == (413, "application/problem+json")
    assert json.loads(content)["type"].endswith(":body_too_large")


@each_proxy
def test_pages_of_its_origin_may_send_requests_and_others_may_not(behind):
    _, port, _, _ = behind
    own, other = f"https://127.0.0.1:{port}", "https://elsewhere.example"
    assert ask(port, "POST", "/v1/jobs", PLANAR, Origin=own)[0] == 202
    assert ask(port, "POST", "/v1/jobs", PLANAR, Origin=other)[0] == 403


@each_proxy
def test_events_are_sent_on_at_once(behind):
    _, port, _, _ = behind
    job = json.loads(
        ask(port, "POST", "/v1/jobs", {**PLANAR, "motion": {"type": "planar", "lambda": "3/4"}})[2]
    )
    with closing(connection(port)) as client:
        client.request("GET", f"{PREFIX}/v1/jobs/{job['id']}/events")
        answer = client.getresponse()
        assert answer.getheader("Content-Type").startswith("text/event-stream")
        told = b""
        # The stream goes on: what has come without its end was not kept back.
        while b"succeeded" not in told:
            line = answer.readline()
            assert line, told
            told += line


@each_proxy
def test_an_answer_that_breaks_off_is_no_answer_through_a_proxy_either(name, tmp_path):
    if name == "caddy" and version_of_caddy() < (2, 8):
        pytest.skip("before 2.8 Caddy ends such an answer as if it were whole")
    url = url_of(tmp_path / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, POINTS)
    with (
        serving(tmp_path, workers=0, POLHODE_DATABASE_URL=url) as service,
        proxied(name, tmp_path / "proxy", service) as port,
        closing(connection(port)) as client,
    ):
        client.request("GET", f"{PREFIX}/v1/sweeps/{sweep_id}/points?format=csv")
        answer = client.getresponse()
        assert answer.status == 200
        answer.read(1000)
        service.process.send_signal(signal.SIGKILL)
        with pytest.raises((http.client.IncompleteRead, OSError)):
            answer.read()
