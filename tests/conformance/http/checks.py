"""Checks beside those of Schemathesis; it loads this file by its path."""

import json

import schemathesis

FORM = {
    "invalid_choice",
    "invalid_length",
    "invalid_type",
    "invalid_value",
    "missing_field",
    "missing_parameter",
    "repeated_parameter",
    "unknown_field",
    "unknown_parameter",
}
"""Faults that a schema can tell. Ranges are not among them: it has none for numbers that are sent as text."""
TOGETHER = {("GET /v1/solutions/{solution_id}/trajectory", "missing_parameter")}
"""Parameters that belong together: OpenAPI has no words for that."""


@schemathesis.check
def what_is_valid_is_refused_for_its_meaning_only(ctx, response, case) -> None:
    """A request that is as the document says may be refused for what it means, and not for its form.

    No schema says that A ≠ C, that a formula can be read, or that a column exists.
    """
    is_valid = case.meta is not None and case.meta.generation.mode.is_positive
    if not is_valid or response.status_code != 422:
        return
    refusal = json.loads(response.content)
    found = [
        fault
        for fault in refusal.get("errors", ())
        if fault["code"] in FORM and (case.operation.label, fault["code"]) not in TOGETHER
    ]
    assert not found, f"valid by its schema, and refused for {found}"
