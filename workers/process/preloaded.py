"""Loads compiled code into the fork server of a worker, so that every child begins with it.

Unlike all other modules this one does its work when it is imported: to import modules is all that a fork
server can be told. Only a worker names it, as the last module to preload. Code that is not compiled yet is
left to the children, which can be killed: a fork server that compiles for minutes could not be stopped.
"""

import logging

from workers.process.template import accept_orders
from workers.sweeping.warming import is_compiled, warm_up_before_forks

accept_orders()
try:
    if is_compiled():
        warm_up_before_forks()
except Exception as fault:  # the children warm up too, and their worker says what is wrong
    logging.getLogger(__name__).debug("nothing is loaded ahead: %s", fault)
