"""Recognises properties of a potential that allow faster or more exact methods."""
