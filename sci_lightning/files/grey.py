"""Grey values out of pictures that are stored as colour."""

from __future__ import annotations

import numpy as np

from sci_lightning.errors import BadInput

BAYER = (
    "a mosaic of colour filters (Bayer), which is decoded as if it were grey: take one colour's pixels of snapshot and "
    "mask, such as y[0::2, 0::2] and mask[:, 0::2, 0::2], and decode the four one by one"
)


def grey_of_colours(colours: np.ndarray, kind: str) -> np.ndarray:
    """Return the one channel of a picture whose colours are equal, as grey cameras' software writes them.

    Args:
        colours: ``(..., S)`` of 1 to 4 samples a pixel; of 2 and 4 the last one may be an even opacity, which is left.
        kind: of the picture, for the message.

    Raises:
        BadInput: the colours differ, or there are more.
    """
    samples = colours.shape[-1]
    if samples in (2, 4) and (colours[..., -1] == colours.flat[samples - 1]).all():
        colours = colours[..., :-1]
    if samples > 4 or not (colours == colours[..., :1]).all():
        raise BadInput(
            f"one grey channel is expected, this picture is {kind} of {samples} channels that differ; save the "
            "camera's raw grey values, or one channel"
        )
    return colours[..., 0]
