"""Figures of masks, measurements and reconstructions, and animations of videos."""
