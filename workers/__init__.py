"""Solves: claims jobs and runs the numerics in killable child processes."""
