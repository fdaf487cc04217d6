"""Output for people: pictures, tables in notebooks, progress bars."""
