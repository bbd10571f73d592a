"""``python -m sci_lightning.mismatch`` and the command beside it."""
