"""The formula language of clients: own tokens, tree, limits and evaluators."""
