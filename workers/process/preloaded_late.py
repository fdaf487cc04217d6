"""Loads the rest of compiled code into the fork server of a worker, when it is told to load what comes late.

As :mod:`workers.process.preloaded` it does its work when it is imported, if there is nothing to compile.
"""

from workers.sweeping.warming import is_compiled, warm_up_before_forks

if is_compiled():
    warm_up_before_forks()
