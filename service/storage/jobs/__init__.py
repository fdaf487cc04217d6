"""Jobs in SQL: how they come, pass into hands, move and end; who delivers them."""
