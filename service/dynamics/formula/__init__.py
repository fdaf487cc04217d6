"""The formula language of clients: tokens, parser, tree, size limits and evaluators."""
