"""Measures the table of accuracy and speed of this installation."""
