"""``sci.plot``: a snapshot, its frames and their reconstruction, whatever of them there is."""

from __future__ import annotations

import pytest
import torch

import sci_lightning as sci
from sci_lightning.errors import BadInput

VIDEO = torch.rand(2, 6, 16, 20, generator=torch.Generator().manual_seed(0))


def titles(figure: object) -> list[str]:
    return [axes.get_title() for axes in figure.axes]  # type: ignore[attr-defined]


def test_psnr_stands_above_every_frame() -> None:
    estimate = (VIDEO + 0.1).requires_grad_()
    shown = titles(sci.plot(VIDEO.mean(1), VIDEO, estimate, title="a scene"))
    assert shown.count("20.0 dB") == 6 and "measurement" in shown
    assert titles(sci.plot(VIDEO[0].mean(0), VIDEO[0], estimate[0], frames=2)).count("20.0 dB") == 2


def test_frames_or_estimate_alone() -> None:
    """Of a real camera nobody knows the frames; before a reconstruction there is none."""
    for given in ({"video": VIDEO}, {"estimate": VIDEO}):
        shown = titles(sci.plot(VIDEO.mean(1), **given))
        assert [title for title in shown if title.isdecimal()] == ["1", "2", "3", "4", "5", "6"]
        assert not any("dB" in title for title in shown)


def test_a_notebook_shows_it_without_pyplot() -> None:
    assert sci.plot(VIDEO.mean(1), VIDEO)._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


def test_shapes_that_do_not_belong_together() -> None:
    snapshot = VIDEO.mean(1)
    for arguments in (
        (snapshot,),
        (snapshot, VIDEO[0, 0]),
        (snapshot, VIDEO[..., :8]),
        (snapshot, VIDEO, VIDEO[:, :3]),
    ):
        with pytest.raises(BadInput, match="T, H, W"):
            sci.plot(*arguments)
    with pytest.raises(BadInput, match="frames=0"):
        sci.plot(snapshot, VIDEO, frames=0)
