"""Diagnosis of snapshots whose scenes are unknown."""
