"""Decoding a large snapshot in tiles: how it is cut, into which tiles, and the memory that decides it."""
