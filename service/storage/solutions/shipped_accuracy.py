"""Reads the tables of accuracy and speed that are shipped with this version, which need no database."""

from functools import cache
from pathlib import Path

from service.dynamics.accuracy import AccuracyTable
from service.schemas.replies.installation import AccuracyTableModel, ComparedWaysOut, TierCostsOut

SHIPPED = Path(__file__).with_name("shipped_accuracy.json")
SHIPPED_COSTS = Path(__file__).with_name("shipped_costs.json")
SHIPPED_COMPARISON = Path(__file__).with_name("shipped_comparison.json")
"""Written by ``make bench``."""


@cache
def shipped_table() -> AccuracyTable:
    """Return the table, measured on the developers' machine."""
    return AccuracyTableModel.model_validate_json(SHIPPED.read_bytes()).to_domain()


@cache
def shipped_costs() -> TierCostsOut:
    """Return what the tiers cost a user, measured on the developers' machine."""
    return TierCostsOut.model_validate_json(SHIPPED_COSTS.read_bytes())


@cache
def shipped_comparison() -> ComparedWaysOut:
    """Return what other methods and what each output cost, measured on the developers' machine."""
    return ComparedWaysOut.model_validate_json(SHIPPED_COMPARISON.read_bytes())
