"""Training with Lightning: the modules, what they keep, and how they stop.

Only this room knows Lightning."""
