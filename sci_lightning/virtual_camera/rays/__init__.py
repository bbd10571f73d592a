"""A second formulation of the virtual camera: an imperfect set-up, whose light is sampled ray by ray.

:mod:`sci_lightning.virtual_camera.hardware` is faultless but for what is hidden in it, and integrates light in closed
form. Here rays start at random places of mirrors with gaps, run forwards through the relay and are counted where they
land; the exposure is a row of instants; photons, dark current and pixels that differ make the noise; lamps jitter and
printed targets are not quite what the file says (:class:`.ray_camera.Imperfections`). It is coarse where the other
one is exact, and has details that the other one lacks. What is hidden has the same names and parameters in both.
"""
