"""Snapshots: reading them, checking that a mask belongs to them, and showing what was reconstructed."""
