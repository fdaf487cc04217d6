"""The problem document: its parts, the rules between them, and its canonical form."""
