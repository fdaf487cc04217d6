"""The cases, one to a module: conditions, relations and reduced motion."""
