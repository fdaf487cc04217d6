"""Functions are translated once, and linked into what Python calls; parts that were kept fit each other."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

import workers
from service.local.workers import FOLDER_VARIABLE
from tests.support.effort import one_in
from workers.solvers.compiled.kernels import LEVELS, level

ROOT = Path(workers.__path__[0]).parent
KERNELS = """
import numpy as np
from workers.computation.compiled_code import allow_compiling, keep_compiled_code
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.kernels import Kernel

allow_compiling()
keep_compiled_code()
RECORD = np.dtype([("a", np.float64), ("b", np.float64, (4,))], align=True)
TABLE = np.arange(6.0)


@inlined
def twice(x):
    return 2.0 * x


@kernel
def inner(record, out, k):
    if k > 3:
        raise ValueError("there are four")
    for n in range(len(out)):
        out[n] = twice(record.b[k]) + TABLE[n % 6]
    return out.sum()


@kernel
def middle(records, count):
    out = np.zeros(count)
    return inner(records[0], out, 1) + inner(records[1], out, 2)


@kernel
def outer(records, count):
    found = np.zeros(2, dtype=records.dtype)
    found[0].a = middle(records, count) + inner(records[0], np.zeros(count), 3)
    return found, count


def called():
    records = np.zeros(2, dtype=RECORD)
    records["b"] = np.arange(8.0).reshape(2, 4)
    found, count = outer(records, 5)
    # A constant of one call, and that of another, are numbers alike.
    assert isinstance(inner, Kernel) and len(inner.overloads) <= 1
    alone = inner(records[1], np.zeros(5), 0)
    try:
        inner(records[1], np.zeros(5), 4)
    except ValueError as fault:
        assert str(fault) == "there are four"
        return found["a"][0], count, alone, middle(records, 5)
"""
CALL = """
import json
import linked
from numba.core import event

done = []


class Watch(event.Listener):
    def on_start(self, each):
        # numba's own functions have no kind.
        if "kind" in each.data:
            done.append(f"{each.data['dispatcher'].__name__} {each.data['kind']}")

    def on_end(self, each):
        pass


event.register("numba:compile", Watch())
print(json.dumps([linked.called(), sorted(done)]))
"""
AS_ON = """
from numba.core import codegen

codegen.ll.get_host_cpu_name = lambda: {0!r}
codegen.get_host_cpu_features = lambda: {1!r}
"""
LOADER = Path("/lib64/ld-linux-x86-64.so.2")
OTHERS = """
import numba
import numpy as np


@numba.njit
def squares(n):
    return np.arange(n) ** 2


@numba.njit
def total(n):
    return squares(n).sum()


assert total(4) == 14
assert squares(3).tolist() == [0, 1, 4]
"""
SUMS = [2 * 5 * 1 + 2 * 5 * 6 + 2 * 5 * 3, 2 * 5 * 4, 2 * 5 * 1 + 2 * 5 * 6]
"""2 b for each of five places; the numbers of the table add 10 a call."""
RIGHT = [SUMS[0] + 30.0, 5, SUMS[1] + 10.0, SUMS[2] + 20.0]


@pytest.fixture
def call(tmp_path):
    (tmp_path / "linked.py").write_text(KERNELS)

    def call(more="", before=""):
        unset = {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"} if before else {}
        environment = {name: value for name, value in os.environ.items() if name not in unset}
        result = subprocess.run(
            [sys.executable, "-P", "-c", before + CALL + more],
            env={**environment, FOLDER_VARIABLE: str(tmp_path), "PYTHONPATH": f"{ROOT}:{tmp_path}"},
            capture_output=True,
            text=True,
            check=True,
        )
        return result.stdout.strip()

    return call


def of_kind(folder, kind):
    return sorted(file.name.partition("-")[0] for file in folder.rglob(f"*-{kind}.*.nbc"))


def test_each_function_is_translated_once_and_machine_code_is_made_of_what_python_calls(tmp_path, call):
    found = call()
    # By hand; whole numbers, so that there is no rounding.
    assert found.startswith(f"[{RIGHT}".replace("'", '"'))
    assert found.count("inner part") == found.count("twice part") == 1
    assert of_kind(tmp_path, "part") == ["inner", "middle", "outer", "twice"]
    assert of_kind(tmp_path, "entry") == ["inner", "middle", "outer"]
    # Who compiles something else in such a process is not disturbed.
    (tmp_path / "others.py").write_text(OTHERS)
    file = next(tmp_path.rglob("middle-*-entry.1.nbc"))
    file.unlink()
    assert call("import others") == f"[{RIGHT}, ['middle entry']]".replace("'", '"')
    # A second process compiles nothing.
    assert call() == f"[{RIGHT}, []]"


@pytest.mark.long
@pytest.mark.parametrize("lost", one_in(3, ["middle", "inner", "outer"]))
def test_parts_of_several_processes_are_linked(tmp_path, call, lost):
    call()
    for file in [*tmp_path.rglob("*-entry.*"), *tmp_path.rglob(f"{lost}-*-part.*")]:
        file.unlink()
    made = [f"{name} entry" for name in ("inner", "middle", "outer")]
    assert call() == f"[{RIGHT}, {sorted([*made, f'{lost} part'])}]".replace("'", '"')
    assert call() == f"[{RIGHT}, []]"


def features(*levels):
    return ",".join(f"+{each}" for name in levels for each in sorted(LEVELS[name]))


@pytest.mark.parametrize(("place", "name"), list(enumerate(LEVELS)))
def test_a_level_is_there_with_all_of_its_features_whatever_else_a_processor_has(place, name):
    listed = features(*list(LEVELS)[: place + 1])
    assert level(listed) == level(f"+zzz,{listed},-aes,+sha") == name
    below = list(LEVELS)[place - 1] if place else None
    for each in LEVELS[name]:
        assert level(",".join(set(listed.split(",")) - {f"+{each}"} | {f"-{each}"})) == below


@pytest.mark.skipif(not LOADER.exists(), reason="the loader of GNU is not here")
def test_the_level_of_this_processor_is_the_one_that_the_loader_finds():
    environment = {name: value for name, value in os.environ.items() if name != "GLIBC_TUNABLES"}
    said = subprocess.run([LOADER, "--help"], env=environment, capture_output=True, text=True, check=True)
    found = re.findall(r"(x86-64-v\d) \(supported", said.stdout)
    assert level(binding.get_host_cpu_features().flatten()) == max(found, default=None)


@pytest.mark.long
@pytest.mark.skipif(level(binding.get_host_cpu_features().flatten()) is None, reason="no such level here")
def test_code_of_one_model_is_found_on_another_of_its_level_and_not_on_one_below(call):
    everything = [f"{name} entry" for name in ("inner", "middle", "outer")]
    everything += [f"{name} part" for name in ("inner", "middle", "outer", "twice")]
    compiled = f"[{RIGHT}, {sorted(everything)}]".replace("'", '"')
    listed = features("x86-64-v2")
    assert call(before=AS_ON.format("nehalem", f"{listed},-movbe")) == compiled
    assert call(before=AS_ON.format("silvermont", f"{listed},+movbe,+prfchw")) == f"[{RIGHT}, []]"
    # It has no level, and is known by its model.
    assert call(before=AS_ON.format("core2", listed.replace("+sse4.2,", ""))) == compiled
