"""The page that people look at: HTML shells and static files; it asks the public API from the browser."""
