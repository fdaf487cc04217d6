"""The integrals along computed motions, with twice the digits of doubles, which tell what balls round to."""
