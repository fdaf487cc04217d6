"""Keeps the verdicts and windows that were found."""
