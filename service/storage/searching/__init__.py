"""Answers queries: conditions and orders as SQL, pages by cursor, counts and statistics."""
