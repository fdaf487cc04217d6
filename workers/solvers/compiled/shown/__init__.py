"""What a function of time shows of its error, by compiled code: the equations at nodes and on discs."""
