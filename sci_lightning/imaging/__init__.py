"""Snapshots: how they form (the snapshot operator), reading them, checking their masks, and showing reconstructions."""
