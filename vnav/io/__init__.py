"""Files: capture readers, the map folder, writers."""
