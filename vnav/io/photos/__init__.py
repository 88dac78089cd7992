"""Photos and what their files say of their camera."""
