"""Motions as functions of time, evaluated here."""
