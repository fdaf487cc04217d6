"""Connects to the database: engine, schema revisions, clock, ids, and which errors mean an outage."""
