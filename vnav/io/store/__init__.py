"""The map folder and what the stages keep in it."""
