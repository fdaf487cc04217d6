"""What the catalogue says: families of potentials and named cases, each with an example problem."""
