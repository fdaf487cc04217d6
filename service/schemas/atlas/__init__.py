"""The documents of atlases: what is asked, and the answer."""
