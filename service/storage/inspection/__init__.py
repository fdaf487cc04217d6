"""What must hold in every database, and how it is mended."""
