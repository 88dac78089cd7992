"""Which parts of the map a photo matches: words, ratio tests, covisibility clusters."""
