"""Searches of the numbers of problems that give what is wanted: doubles propose, balls prove."""
