"""Apart, since it does its work when it is imported: loads compiled code into the fork server of a worker.

To import modules is all that a fork server can be told, and every child begins with what it has loaded. Only
a worker names this one, as the last module to preload. Code that is not compiled yet is left to the children,
which can be killed: a fork server that compiles for minutes could not be stopped.
"""

import logging

from workers.process.tasks import accept_orders
from workers.sweeping.warming import is_compiled, warm_up_for_first_jobs

accept_orders()
try:
    if is_compiled():
        warm_up_for_first_jobs()
except Exception as fault:  # the children warm up too, and their worker says what is wrong
    logging.getLogger(__name__).debug("nothing is loaded ahead: %s", fault)
