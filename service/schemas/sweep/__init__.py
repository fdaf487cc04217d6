"""The sweep document: one problem, some of whose numbers vary along axes."""
