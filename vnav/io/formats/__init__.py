"""Files as other programs read and write them, too."""
