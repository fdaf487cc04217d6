"""Bounds how far a computed function of time is from satisfying the differential equations."""
