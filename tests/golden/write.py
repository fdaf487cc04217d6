"""``python -m tests.golden.write``: write the digits of the declared numerics.

If the file is of these numerics, only the bits of this processor are added to
it; else everything is written anew.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from service.dynamics.numerics import NUMERICS
from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from tests.golden.documents import DOCUMENTS
from workers.computation.compiled_code import libraries, processor
from workers.computation.compute import solve_document

FILE = Path(__file__).with_name("digits.json")


def computed(document: dict[str, object]) -> dict[str, object]:
    outcome = solve_document(json.dumps(document))
    assert isinstance(outcome, Solved), outcome
    summary = outcome.summary
    columns = {name: values.tolist() for name, values in decode_arrays(outcome.samples).items()}
    numbers = {name: summary[name] for name in ("period", "energy", "error")}
    return {"numbers": json.loads(json.dumps(numbers)), "columns": columns}


def bits_of(found: Mapping[str, object]) -> str:
    """Return a digest of every bit of what was computed; JSON writes a double in full."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()


def key() -> str:
    """Return what the bits belong to."""
    return f"{processor()}; {libraries()}"


def main() -> None:
    found = {name: computed(document) for name, document in DOCUMENTS.items()}
    stored = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    if stored.get("numerics") != NUMERICS:
        stored = {"numerics": NUMERICS, "digits": found, "bits": {}}
    stored["bits"][key()] = {name: bits_of(each) for name, each in found.items()}
    FILE.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
