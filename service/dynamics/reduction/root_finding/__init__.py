"""Finds the zeros of p² on a loop, their orders, and gaps too narrow for doubles."""
