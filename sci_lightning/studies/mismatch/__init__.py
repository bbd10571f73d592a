"""What it costs that a camera differs from the model that its decoder believes, and what a diagnosis wins back.

:mod:`~.cameras` says which cameras there are, :mod:`~.bench` records with
them, :mod:`~.beliefs` says what the decoder believes, :mod:`~.protocol`
decodes and scores, :mod:`~.records` keeps the results.
"""

from __future__ import annotations
