"""Which pose is given, how sure it is, and how far off it may be; or why none is given."""
