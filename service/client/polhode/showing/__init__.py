"""What people see: pictures, tables in notebooks, bars of progress."""
