"""Apart, since it does its work when it is imported: has a fork server collect garbage seldom.

To import modules is all that a fork server can be told; this is the first one that it gets.
"""

from service.startup import collect_seldom

collect_seldom()
