"""What it costs that a camera differs from the model that its decoder believes, and what a diagnosis wins back.

:mod:`~sci_lightning.mismatch.cameras` says which cameras there are, :mod:`~sci_lightning.mismatch.bench` records with
them, :mod:`~sci_lightning.mismatch.beliefs` says what the decoder believes, :mod:`~sci_lightning.mismatch.protocol`
decodes and scores, :mod:`~sci_lightning.mismatch.records` keeps the results.
"""

from __future__ import annotations
