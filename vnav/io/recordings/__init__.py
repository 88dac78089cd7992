"""Recordings that are no folders of images, written as such: docs/captures.md, "Robots"."""
