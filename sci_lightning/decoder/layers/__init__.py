"""Layers that several decoders share, written as their papers have them."""
