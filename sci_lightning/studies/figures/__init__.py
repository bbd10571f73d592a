"""Figures beside the tables: of runs with their checkpoints, and, with their tables, of files alone."""
