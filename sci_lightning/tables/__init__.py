"""``python -m sci_lightning.tables`` and the commands beside it."""
