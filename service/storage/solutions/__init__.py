"""Stores solutions, their arrays, and the measured tables of accuracy and speed."""
