"""The endpoints of the installation: its health and state, its catalogue, its documentation."""
