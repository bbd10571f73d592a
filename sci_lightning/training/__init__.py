"""Training with Lightning: the LightningModules, their checkpoints and callbacks, and how a training is stopped.

No other package of the library imports Lightning, except for the commands that train and evaluate.
"""
