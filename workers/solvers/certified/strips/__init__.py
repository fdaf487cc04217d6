"""Proves facts about functions of the phase on a strip of the complex plane about the real axis."""
