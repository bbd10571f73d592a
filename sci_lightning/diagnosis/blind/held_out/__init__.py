"""Held-out pixels of unknown scenes: what a camera is worth that predicts them from the others."""
