"""The model of a camera: what a hypothesis predicts for every capture, and how likely the recorded numbers are."""
