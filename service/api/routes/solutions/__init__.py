"""The endpoints of one solution, and the list of solutions."""
