"""Whole jobs and whole requests, as their users meet them, beside what they could be at best."""
