"""Figures and tables that are made of files alone, without a run: of real snapshots, of masks."""
