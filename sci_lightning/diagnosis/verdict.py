"""The verdict of a diagnosis: which of the four words follows from the held-out gap and from what is left."""

from __future__ import annotations

from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.search_settings import SearchSettings

NEGLIGIBLE = SearchSettings.negligible_chi2
"""Reduced chi2 on held-out pixels that is of no practical relevance, however many pixels prove that it is above 1."""


def verdict(before: Gap, after: Gap, named: int, unnamed: int, remaining: int) -> str:
    """Return ``consistent``, ``explained``, ``partly_explained`` or ``unexplained``.

    Nothing is left if the misfit is within what chance allows, nothing unnamed was found, and no residual test objects.
    Then the captures are ``consistent`` with the ideal camera, or ``explained`` by the effects named. Otherwise they
    are ``partly_explained`` if the effects named make the held-out pixels likelier. Likelihood decides here and not
    chi2, because chi2 rises towards 1 where the noise had been overestimated.

    Args:
        before: gap of the ideal camera, on verification captures where some are kept.
        after: gap of the corrected model, on the same pixels.
        named: how many effects were named.
        unnamed: how many deviations without a name were found.
        remaining: how many residual tests find more than noise in what the corrected model leaves.
    """
    if after.within_chance and not unnamed and not remaining:
        return "explained" if named else "consistent"
    return "partly_explained" if named and after.nll < before.nll else "unexplained"
