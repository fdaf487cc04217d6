"""Sending of requests: what an operation asks for, who carries it out, what is sent again or cached."""
