"""The optics and electronics of the virtual camera, one module for each part, with the effects that act there."""
