"""Connections of clients: how many, how long, and what is told to those that are refused."""
