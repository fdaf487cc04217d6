"""Stores API keys, their roles and their usage."""
