"""The way to a service: proxies and certificates of the environment, and whose answer an answer is."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import httpx
import pytest

import polhode as ph
from polhode.transport.terms import proxy_of

VARIABLES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY", "SSL_CERT_FILE", "SSL_CERT_DIR")


@pytest.fixture(autouse=True)
def no_way(monkeypatch):
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@pytest.fixture
def proxy() -> Iterator[HTTPServer]:
    """A proxy that answers every request itself, and remembers what it was asked for."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.server.asked.append(self.path)
            content = b'{"id": "x", "state": "queued", "progress": 0}'
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        server.asked = []
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    "variables",
    [
        {"HTTP_PROXY": "http://127.0.0.1:9"},
        {"ALL_PROXY": "socks5://127.0.0.1:9", "NO_PROXY": "localhost,::1/128"},
        {"https_proxy": "no address at all", "SSL_CERT_FILE": "/no/such/file"},
    ],
    ids=str,
)
def test_loopback_is_asked_without_a_proxy(service, monkeypatch, variables):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with ph.connect(service.address.replace("127.0.0.1", "localhost")) as client:
        assert client.jobs().count() >= 0


@pytest.mark.parametrize("name", ["HTTP_PROXY", "all_proxy"])
def test_others_are_asked_by_the_proxy_of_the_environment(proxy, monkeypatch, name):
    monkeypatch.setenv(name, f"127.0.0.1:{proxy.server_port}")
    monkeypatch.setenv("NO_PROXY", "localhost,::1/128,10.0.0.0/8")
    with ph.connect("http://polhode.example:8000", cache=False) as client:
        assert client.job("x").state == "queued"
    assert proxy.asked == ["http://polhode.example:8000/v1/jobs/x"]


@pytest.mark.parametrize(
    ("url", "listed", "has_proxy"),
    [
        ("http://polhode.example", "", True),
        ("http://polhode.example", "example", False),
        ("http://a.polhode.example:8000", ".polhode.example", False),
        ("http://notpolhode.example", "polhode.example", True),
        ("http://polhode.example:8000", "polhode.example:8000", False),
        ("http://10.1.2.3", "localhost, 10.0.0.0/8", False),
        ("http://11.1.2.3", "localhost, 10.0.0.0/8", True),
        ("http://[fd00::7]:8000", "::1/128,fd00::/8", False),
        ("http://polhode.example", "*", False),
        ("https://polhode.example", "", False),  # no proxy for https
        ("http://127.9.9.9", "", False),
        ("http://[::1]:8000", "", False),
        ("http://polhode.localhost", "", False),
    ],
)
def test_a_proxy_is_chosen_as_the_environment_says(monkeypatch, url, listed, has_proxy):
    monkeypatch.setenv("HTTP_PROXY", "http://proxy.example:3128")
    monkeypatch.setenv("NO_PROXY", listed)
    assert (proxy_of(url) is not None) == has_proxy


def test_messages_name_the_proxy_and_its_variable(monkeypatch):
    monkeypatch.setenv("HTTP_PROXY", "http://me:secret@127.0.0.1:9")
    with (
        ph.connect("http://polhode.example", patience=0.2) as client,
        pytest.raises(
            ph.UnreachableError, match=r"asked by the proxy http://127.0.0.1:9 of HTTP_PROXY"
        ) as told,
    ):
        client.job("x")
    assert "secret" not in str(told.value)


@pytest.mark.parametrize(
    ("variables", "told"),
    [
        (
            {"ALL_PROXY": "socks5://proxy.example:1080"},
            r"proxy.example:1080 of ALL_PROXY needs socksio: pip install",
        ),
        ({"HTTPS_PROXY": "gopher://proxy.example"}, "of HTTPS_PROXY cannot be used"),
        ({"SSL_CERT_FILE": "/no/such/file"}, "no /no/such/file, which SSL_CERT_FILE names"),
        ({"SSL_CERT_FILE": __file__}, f"SSL_CERT_FILE={__file__}"),
    ],
    ids=str,
)
def test_what_the_environment_has_wrong_is_told_with_its_variable(monkeypatch, variables, told):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with (
        ph.connect("https://polhode.example") as client,
        pytest.raises(ph.WrongArgumentError, match=told),
    ):
        client.job("x")


@pytest.mark.parametrize("word", ["a1b2", "x" * 128])
def test_the_service_returns_a_word_as_it_was_sent(service, word):
    for path in ("/livez", "/v1/jobs/none", "/v1/nowhere"):
        answer = service.call("GET", path, Polhode_Echo=word)
        assert answer.headers["polhode-echo"] == word
    assert "polhode-echo" not in service.call("GET", "/livez", Polhode_Echo="two words").headers
    assert "polhode-echo" not in service.call("GET", "/livez").headers


def test_an_answer_to_another_request_is_asked_for_again(monkeypatch):
    sent = []

    def answer(request: httpx.Request) -> httpx.Response:
        sent.append(request.headers["Polhode-Echo"])
        word = sent[0]  # as if it were the first one's, for ever
        return httpx.Response(200, headers={"Polhode-Echo": word}, json={"id": word, "state": "queued"})

    def made(kind, terms):
        return kind(base_url=terms.url, transport=httpx.MockTransport(answer))

    monkeypatch.setattr("polhode.transport.carriers._made", made)
    with ph.connect("http://127.0.0.1:9", cache=False, patience=0.5) as client:
        http = client.carrier.connections.of().http
        assert client.job("x").id == sent[0]
        # The second answer is the first one's: nobody gets it, and the connections are left.
        with pytest.raises(ph.UnreachableError, match="the answer was to another request"):
            client.job("x")
        assert client.carrier.connections.of().http is not http
    assert len(set(sent)) == len(sent) >= 2
