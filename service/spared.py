"""Spares the garbage collector what a fork server loads.

Like ``workers.process.preloaded`` this module does its work when it is imported, since to import modules is
all that a fork server can be told. It is the first one that is preloaded.
"""

from service.startup import collect_seldom

collect_seldom()
