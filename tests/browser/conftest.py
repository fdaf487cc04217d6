"""One service with real solutions, and Chromium to look at its page."""

import os
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, expect, sync_playwright

from tests.support.browser import FLAGS, Site, Watched, chromium, fill_site
from tests.support.serving import serving

PATIENCE_SECONDS = 60
"""How long a busy machine may take until a page shows what it must show in the end."""


@pytest.fixture(scope="session")
def chromium_path() -> str:
    path = chromium()
    if path is None:
        assert not os.environ.get("POLHODE_NEEDS_BROWSER"), (
            "there is no Chromium, and POLHODE_NEEDS_BROWSER is set"
        )
        pytest.skip("no Chromium here: `apt-get install chromium`")
    return path


@pytest.fixture(scope="session")
def site(chromium_path, tmp_path_factory) -> Iterator[Site]:
    with serving(tmp_path_factory.mktemp("site")) as service:
        yield fill_site(service)


# Not of the session: while it runs, tests of other folders could start no event loop.
@pytest.fixture(scope="module")
def browser(chromium_path) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium_path, args=FLAGS)
        yield running
        running.close()


@pytest.fixture
def context(browser) -> Iterator[BrowserContext]:
    # Bodies that turn by themselves take a processor from the tests: only where it is asked for.
    opened = browser.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    opened.set_default_timeout(1000 * PATIENCE_SECONDS)
    expect.set_options(timeout=1000 * PATIENCE_SECONDS)
    yield opened
    opened.close()


@pytest.fixture
def tab(context, site) -> Iterator[Watched]:
    """A tab; whatever goes wrong in it fails the test."""
    watched = Watched(context.new_page(), site)
    yield watched
    assert watched.faults == []
