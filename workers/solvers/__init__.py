"""Pure mathematics: how a problem is solved."""
