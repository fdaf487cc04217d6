"""A service that asks for keys, and one that goes away while somebody watches."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

import pytest
from playwright.sync_api import expect

from service.storage.jobs.rows import BEGUN
from tests.support.browser import Site, Watched, problem, settle
from tests.support.serving import serving
from tests.support.waiting import wait_until

POLHODE = Path(sys.executable).with_name("polhode")


@pytest.fixture(scope="module")
def guarded(chromium_path, tmp_path_factory):
    """A service without workers that asks for a key, and a key that may read."""
    folder = tmp_path_factory.mktemp("guarded")
    subprocess.run([POLHODE, "migrate"], cwd=folder, check=True, capture_output=True)
    command = [POLHODE, "keys", "create", "--role", "read", "--name", "reader"]
    told = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    (key,) = [word for word in told.stdout.split() if word.startswith("plh_") and len(word) > 20]
    with serving(folder, workers=0) as service:
        yield Site(service, {}, ""), key


def test_a_key_is_typed_once_and_kept_in_the_tab_only(context, guarded):
    site, key = guarded
    tab = Watched(context.new_page(), site)
    page = tab.open("")
    dialog = page.get_by_role("dialog", name="Key of this service")
    expect(dialog).to_contain_text("a key is needed")
    page.get_by_label("Key", exact=True).fill(key)
    page.keyboard.press("Enter")
    expect(page.locator("#status")).to_contain_text("Waiting")
    settle(page)
    expect(page.locator("#workers")).to_have_text(
        "No worker: nothing will be computed. Start one: polhode worker."
    )
    tab.open("solutions")  # another page of the same tab: nobody is asked again
    settle(page)
    expect(dialog).to_be_hidden()
    expect(page.locator("main")).to_contain_text("There is nothing yet.")
    assert key not in page.url
    assert context.cookies() == []
    assert page.evaluate("Object.values(localStorage)") == []
    other = context.new_page()
    other.goto(site.address)
    expect(other.get_by_role("dialog", name="Key of this service")).to_be_visible()
    # What was refused is what was asked before the key was known, and nothing else.
    assert {fault.split()[0] for fault in tab.faults} == {"401"}


def test_a_late_refusal_asks_nobody_for_the_key_that_they_have_typed(context, guarded):
    site, key = guarded
    tab = Watched(context.new_page(), site)
    held = []

    def hold(route):
        if "authorization" in route.request.headers:
            route.continue_()
        else:
            held.append(route)

    tab.page.route("**/v1/sweeps?*", hold)
    page = tab.open("")
    dialog = page.get_by_role("dialog", name="Key of this service")
    expect(dialog).to_contain_text("a key is needed")
    wait_until(lambda: page.title() and held)  # asking the page lets the request be seen
    page.get_by_label("Key", exact=True).fill(key)
    page.keyboard.press("Enter")
    expect(dialog).to_be_hidden()
    with page.expect_request(lambda request: "/v1/sweeps?" in request.url) as again:
        for route in held:
            route.continue_()
    assert again.value.headers["authorization"] == f"Bearer {key}"
    expect(page.locator("#status")).to_contain_text("Waiting")
    expect(dialog).to_be_hidden()


def test_without_a_key_the_page_says_what_is_missing(context, guarded):
    site, _ = guarded
    page = Watched(context.new_page(), site).open("solutions")
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    expect(page.locator("main")).to_contain_text("a key is needed")


def test_a_key_that_may_read_is_told_once_what_it_lacks_and_nothing_is_red(context, guarded):
    site, key = guarded
    tab = Watched(context.new_page(), site)
    tab.page.add_init_script(f"sessionStorage.setItem('polhode.key', '{key}')")
    page = tab.open("workbench#" + quote(json.dumps(problem("first"))))
    expect(page.locator("#verdict")).to_contain_text("Admissible")
    expect(page.locator("#job")).to_have_text(
        "This needs a key with the role submit; the one in use may do less."
    )
    expect(page.get_by_role("button", name="Compute")).to_be_disabled()
    expect(page.locator(".sweep-open").first).to_be_disabled()
    settle(page)
    assert page.locator(".notice.bad:visible, .fault:visible").count() == 0
    assert tab.faults == [f"403 {site.address}/v1/atlases"]


LOST = {
    "503",  # what a service answers that is about to end
    "net::ERR_CONNECTION_CLOSED",
    "net::ERR_CONNECTION_REFUSED",
    "net::ERR_CONNECTION_RESET",
    "net::ERR_EMPTY_RESPONSE",
    "net::ERR_INCOMPLETE_CHUNKED_ENCODING",
    "net::ERR_SOCKET_NOT_CONNECTED",
}
"""What a browser tells of a service that is gone or going."""


def test_a_service_that_is_started_again_is_found_again(context, chromium_path, tmp_path):
    with serving(tmp_path, workers=0) as service:
        tab = Watched(context.new_page(), Site(service, {}, ""))
        page = tab.open("")
        expect(page.locator("#status")).to_contain_text("Waiting0")
        # The last that it loads: a service that ends before would be told where the page would be.
        expect(page.locator("#cards")).to_contain_text("Nothing has been solved yet")
        assert tab.faults == []
    expect(page.locator("#pulse")).to_contain_text("does not answer")
    expect(page.locator("#status")).to_contain_text("Waiting0")  # what is known is still shown
    port = int(service.address.rsplit(":", 1)[1])
    with serving(tmp_path, workers=0, port=port) as service:
        expect(page.locator("#pulse")).to_be_empty()
        # Nobody reloads the page: it is told by the new service's events.
        service.call("POST", "/v1/jobs", problem("first"))
        expect(page.locator("#status")).to_contain_text("Waiting1")
        page.goto("about:blank")
    assert {fault.split()[0] for fault in tab.faults} <= LOST


def running_attempt(service):
    """Return the number of the attempt that runs, 0 if none does."""
    (job,) = service.call("GET", "/v1/jobs").document["items"]
    return job["attempt"] if job["state"] == "running" else 0


def last_attempt(service):
    (job,) = service.call("GET", "/v1/jobs").document["items"]
    return service.call("GET", f"/v1/jobs/{job['id']}/attempts").document["items"][-1]


def test_the_page_waits_where_too_much_is_read_and_says_so(tab):
    refusals = [
        {"type": "urn:polhode:problem:busy", "title": "Too much is being read", "detail": "try again later"}
    ]

    def refuse_once(route):
        if refusals:
            headers = {"Retry-After": "1", "Content-Type": "application/problem+json"}
            route.fulfill(status=503, headers=headers, body=json.dumps(refusals.pop()))
        else:
            route.continue_()

    tab.page.route("**/v1/accuracy*", refuse_once)
    page = tab.open("accuracy")
    expect(page.get_by_text("The service is busy with other requests")).to_be_visible()
    settle(page)
    expect(page.get_by_text("The service is busy with other requests")).to_be_hidden()
    expect(page.locator("main")).to_contain_text("certified")
    assert [fault.split()[0] for fault in tab.faults] == ["503"]
    tab.faults.clear()


def test_the_outcome_is_told_when_a_worker_is_killed(context, chromium_path, tmp_path):
    settings = {"POLHODE_MAX_ATTEMPTS": "1", "POLHODE_LEASE_SECONDS": "1"}
    long = {
        **problem("first"),
        "time": {"periods": 1000, "samples": 100_000},
        "accuracy": {"tier": "certified"},
    }
    with serving(tmp_path, **settings) as service:
        tab = Watched(context.new_page(), Site(service, {}, ""))
        page = tab.open("workbench#" + quote(json.dumps(long)))
        page.get_by_role("button", name="Compute").click()
        expect(page.locator("#job")).to_contain_text("running")
        # The first worker may have died for any reason, the second one had nothing else to compute.
        for attempt in (1, 2):
            wait_until(lambda number=attempt: running_attempt(service) == number)
            if attempt > 1:
                # It is computed alone, and its worker says that a child has begun.
                wait_until(lambda: last_attempt(service)["detail"] == BEGUN)
            status = service.call("GET", "/v1/status").document
            (worker,) = [one for one in status["workers"] if one["running"]]
            # The names of workers are made of host, process and chance.
            os.kill(int(worker["name"].split(":")[-2]), signal.SIGKILL)
        expect(page.locator("#job .bad")).to_contain_text("The job failed: ")
        (job,) = service.call("GET", "/v1/jobs").document["items"]
        assert job["error"]["detail"] in page.locator("#job").inner_text()
        page.goto("about:blank")
    assert tab.faults == []


def test_events_are_shown_as_they_come(tab):
    status = tab.site.service.call("GET", "/v1/status").document
    status["queue"] = [{"jobs": 7321, "kind": "problem", "oldest_seconds": 1.0, "state": "queued"}]
    # In two lines of data and with a comment before it, as the format allows.
    first, second = json.dumps(status).split(", ", 1)
    text = f": hello\n\nid: 7\nevent: status\ndata: {first},\ndata: {second}\n\n"
    tab.page.context.route(
        "**/v1/events", lambda route: route.fulfill(content_type="text/event-stream", body=text)
    )
    with tab.page.expect_request(
        lambda request: request.url.endswith("/v1/events") and request.headers.get("last-event-id") == "7"
    ):
        page = tab.open("")
        expect(page.locator("#status")).to_contain_text("7321")
