"""No compiled module is tested only through others: a wrong bound can hide behind a right result."""

import re
from pathlib import Path

import workers.solvers.compiled as room

HERE = Path(__file__)


def test_every_compiled_module_is_imported_by_a_test():
    base = Path(room.__file__).parent
    files = [file.relative_to(base).with_suffix("") for file in base.rglob("*.py")]
    modules = {".".join(file.parts) for file in files if file.name != "__init__"}
    texts = [file.read_text(encoding="utf-8") for file in HERE.parents[3].rglob("test_*.py") if file != HERE]
    named = set()
    for text in texts:
        named |= set(re.findall(r"workers\.solvers\.compiled\.([\w.]+)", text))
        for inside, several in re.findall(r"from workers\.solvers\.compiled(\.\w+)? import ([\w, ]+)", text):
            named |= {f"{inside}.{name}".lstrip(".") for name in re.findall(r"\w+", several)}
    assert modules <= named, sorted(modules - named)
