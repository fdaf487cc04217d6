"""Nothing is in the code for tests alone, and no name of a class has two meanings."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from tests.support.reach import modules_below, unreached

ROOT = Path(__file__).parents[1]
ENTRIES = [
    ("service.cli.main", "main"),
    ("service.api.openapi", "main"),
    ("workers.__main__", "main"),
]
CALLED_FROM_OUTSIDE = {
    "service.api.formats.columns.Sink.writable": "pyarrow asks it",
    "service.api.prometheus._DatabaseCollector.describe": "prometheus_client asks it",
    "service.connections.gate.Gate.flow": "what the protocol tells when asyncio says that a client reads",
    "service.connections.gate.Gate.stop_flowing": "the same when it does not read",
    "service.connections.server.WatchedProtocol.": "asyncio and uvicorn call the methods of a protocol",
    "service.connections.server.malformed": "what the protocol answers when uvicorn asks it to refuse",
    "service.client.polhode.": "people call it from Python",
    "service.cli.common.Command.get_short_help_str": "typer lists it in help",
    "service.storage.tables.base.Word.process_bind_param": "SQLAlchemy calls it",
    "workers.process.dask_worker.": "Dask's workers and its scheduler load it, and call the plugin",
    "workers.cli.sweep._RateColumn.render": "rich draws it",
    "workers.solvers.compiled.kernels.": "numba calls the methods of a library and of a dispatcher",
}
"""What names do not lead to, or what begins so, and who calls it. All else that only tests refer to belongs
into tests/support/witnesses."""

RECORDS = tuple(f"workers.solvers.compiled.{name}" for name in ("records", "workspace", "general.records"))
"""What compiled code takes instead of our objects has the names of what it is a record of."""


@pytest.fixture(scope="module")
def modules():
    return modules_below(ROOT, ["service", "workers"])


def test_what_only_tests_refer_to_is_with_the_tests(modules):
    found = unreached(modules, ENTRIES)
    assert [name for name in found if not name.startswith(tuple(CALLED_FROM_OUTSIDE))] == []


def test_a_function_that_nobody_calls_is_found():
    modules = {
        "one": ast.parse(
            "from two import used, idle\nclass C:\n  def f(self): used()\n  def g(self): idle()\nC().f"
        ),
        "two": ast.parse("def used(): helper()\ndef idle(): lost()\ndef helper(): ...\ndef lost(): ..."),
        "three": ast.parse("@app.get('/')\ndef route(): inner()\ndef inner(): ..."),
    }
    assert unreached(modules, []) == ["one.C.g", "two.idle", "two.lost"]


def test_no_text_and_no_bytes_become_code(modules):
    """A formula is data that an interpreter goes through: nothing that somebody typed can be run."""
    names = [
        (module, node.id)
        for module, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Name) and node.id in ("exec", "eval", "marshal", "compile")
    ]
    assert names == []


def test_no_two_classes_have_one_name(modules):
    places = defaultdict(list)
    for module, tree in modules.items():
        # The client is a distribution of its own: its names are what people know of our things.
        of = "client: " if module.startswith("service.client.") else ""
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_") and module not in RECORDS:
                places[of + node.name].append(module)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
