"""One thread at a time computes in balls: their precision is one setting of the whole process.

A thread that leaves its precision sets back what it found, which is another thread's: that one would go on
with fewer bits than it asked for.
"""

from threading import Lock

ONE_AT_A_TIME = Lock()
"""Held by whoever computes in balls in a process of many threads."""
