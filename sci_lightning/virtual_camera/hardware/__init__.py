"""The parts of the virtual camera, and the effects that can be hidden in each."""
