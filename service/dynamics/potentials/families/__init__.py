"""The families of potentials, one file each; they do not know each other."""
