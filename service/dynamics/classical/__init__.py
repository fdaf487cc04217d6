"""The classical particular solutions of the heavy body, as a catalogue that can be computed."""
