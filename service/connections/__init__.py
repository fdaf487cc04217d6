"""Limits the number and duration of client connections, and answers those that are refused."""
