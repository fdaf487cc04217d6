"""The language that lists are asked in: conditions, orders and columns."""
