"""Writes the OpenAPI document: ``python -m service.api.openapi [FILE]``, by default docs/openapi.json."""

import json
import sys
from pathlib import Path

from fastapi import FastAPI

from service.api.routing import install


def openapi_text() -> str:
    """Return the document as it is committed."""
    app = FastAPI(openapi_url=None)
    install(app)
    return json.dumps(app.openapi(), indent=2, ensure_ascii=False, sort_keys=True) + "\n"


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/openapi.json")
    target.write_text(openapi_text(), encoding="utf-8")
