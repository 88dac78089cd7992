"""Front-ends that find and describe features, and their matching."""
