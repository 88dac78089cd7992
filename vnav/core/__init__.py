"""Values and geometry: numpy only, pure, no files."""
