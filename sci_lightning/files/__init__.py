"""File formats: files from anywhere, read within bounds, and files of our own, written whole."""
