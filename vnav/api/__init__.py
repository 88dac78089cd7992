"""What `import vnav` offers and what the commands call; docs/api.md shows each."""
