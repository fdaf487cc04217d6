"""The table of accuracy and speed of this installation, measured."""
