"""Fits are compared on the same pixels: on those that depend on the unknown surround by none of them."""

from __future__ import annotations

from sci_lightning.diagnosis.fit.fit import Fit, Fitter


def judged_by(judge: Fitter, fit: Fit, maker: Fitter) -> Fit:
    """Return a fit as ``judge`` makes it, for which other pixels may count than for its maker."""
    return fit if judge.split.border == maker.split.border else judge.again(fit)


def compared_alike(fitter: Fitter, *fits: Fit) -> tuple[Fitter, list[Fit]]:
    """Return a fitter whose border suffices for several fits, and the fits with the pixels that count for it.

    Args:
        fitter: made all the fits.
        fits: to be compared.
    """
    wider = fitter.covering(*(fit.hypothesis for fit in fits))
    return wider, list(fits) if wider is fitter else [judged_by(wider, fit, fitter) for fit in fits]
