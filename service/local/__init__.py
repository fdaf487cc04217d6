"""Runs workers beside the service on one machine: start, restart, wake-up, and the name of the host."""
