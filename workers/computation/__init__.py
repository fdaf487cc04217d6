"""Computes one problem: from its document to a solution with error bounds, and its documents."""
