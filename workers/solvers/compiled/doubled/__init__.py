"""Twice the digits of doubles: ends, samples and periods that lose none of those of a double."""
