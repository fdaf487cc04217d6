"""``python -m tests.golden.write``: write the digits of the declared numerics anew."""

import json
from pathlib import Path

from service.dynamics.numerics import NUMERICS
from service.storage.solutions.codec import decode_arrays
from tests.golden.documents import DOCUMENTS
from workers.computation import solve_document

FILE = Path(__file__).with_name("digits.json")


def computed(document: dict[str, object]) -> dict[str, object]:
    outcome = solve_document(json.dumps(document))
    assert outcome.summary is not None, outcome.error
    summary = outcome.summary
    columns = {name: values.tolist() for name, values in decode_arrays(outcome.samples).items()}
    is_integrated = summary["method"] == "integration"
    exact = {} if is_integrated else {name: summary[name] for name in ("period", "energy")}
    return {"exact": json.loads(json.dumps(exact)), "columns": columns}


def main() -> None:
    digits = {name: computed(document) for name, document in DOCUMENTS.items()}
    text = json.dumps({"numerics": NUMERICS, "digits": digits}, indent=1)
    FILE.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
