"""Structural masks: the paper's Algorithm 1 as a pure function."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.encoder.rounding import round_half_up, straight_through
from sci_lightning.errors import BadInput, NoSuchCombination


def check_bits(bits: int) -> int:
    """Return ``bits`` if it is a bit depth a mask can have, 1 to 8; else raise BadInput."""
    if isinstance(bits, bool) or not isinstance(bits, int) or not 1 <= bits <= 8:
        raise BadInput(f"mask bits must be a whole number from 1 to 8, got {bits!r}")
    return bits


def check_binary(bits: int) -> int:
    """Return ``bits`` if it is 1, the bit depth of a binary mask; else raise BadInput."""
    if check_bits(bits) != 1:
        raise NoSuchCombination(
            f"encoder.mask.bits={bits}: a binary mask has 1 bit; choose bits=1, or a structural mask "
            "(encoder=rsw_sr or lsw_sr), which takes 1 to 8"
        )
    return bits


def structure(mask: torch.Tensor, bits: int) -> torch.Tensor:
    r"""Turn a real-valued mask into a structural mask: discrete levels that sum to 1 over time.

    With :math:`L = 2^{bits}`: round to multiples of 1/L (halves up, 1 becomes 1 - 1/L, a pixel that is dark
    throughout becomes 1/L throughout), then walk through the slots and take from each its rounded share of the surplus.
    With :math:`M_t` the integer level of slot t, :math:`\Omega_t = \sum_{s \ge t} M_s` the levels of the slots that are
    still to come, and :math:`\Sigma_t` the surplus that is left, which starts as :math:`\sum_t M_t - L`,

    .. math:: \Delta_t = \lfloor \Sigma_t M_t / \Omega_t + 1/2 \rfloor, \quad
              \Omega_{t+1} = \Omega_t - M_t, \quad \Sigma_{t+1} = \Sigma_t - \Delta_t .

    Everything after the first rounding is integer arithmetic, so the sum over time is exactly 1. Two cases that the
    printed algorithm leaves open are settled here: the share is 0 once nothing remains (:math:`0/0`), and a pixel
    whose light all fell to one slot keeps :math:`1 - 1/L` there and gives :math:`1/L` to the slot that is
    brightest among the others in the real-valued mask (the earliest of equals). ``bits = 1`` is the one-hot
    index of the brightest slot, the paper's binary structural mask.

    Args:
        mask: ``(T, ...)`` real values in [0, 1], T >= 2.
        bits: mask bit depth, 1 to 8.

    Returns:
        Same shape and dtype; values in {0, 1/L, .., 1 - 1/L} (bits = 1: {0, 1}); sums to 1 over dimension 0.
        The gradient is passed to ``mask`` unchanged (straight-through).

    Raises:
        BadInput: bits outside 1 to 8, or fewer than two slots.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Eq. 5 and Algorithm 1.
    """
    check_bits(bits)
    if mask.shape[0] < 2:
        raise BadInput(f"a structural mask needs at least 2 time slots, got {mask.shape[0]}")
    with torch.no_grad():
        if bits == 1:
            discrete = torch.zeros_like(mask).scatter_(0, mask.argmax(0, keepdim=True), 1.0)
        else:
            discrete = _share_out(mask, 2**bits).to(mask.dtype) / 2**bits
    return straight_through(discrete, mask)


def _share_out(mask: torch.Tensor, levels: int) -> torch.Tensor:
    """Return integer levels ``(T, ...)`` from 0 to levels - 1 that sum to ``levels`` over dimension 0."""
    rounded = round_half_up(mask * levels).clamp(0, levels - 1).to(torch.int32)
    rounded = torch.where(rounded.sum(0) == 0, 1, rounded)
    remaining = rounded.sum(0)
    surplus = remaining - levels
    shared = torch.empty_like(rounded)
    for slot, level in enumerate(rounded):
        # floor(a / b + 1/2) = floor((2a + b) / 2b); where nothing remains the level is 0 and so is its share
        share = torch.div(2 * surplus * level + remaining, 2 * remaining.clamp(min=1), rounding_mode="floor")
        shared[slot] = level - share
        remaining = remaining - level
        surplus = surplus - share
    return _open_second_slot(shared, mask, levels)


def _open_second_slot(shared: torch.Tensor, mask: torch.Tensor, levels: int) -> torch.Tensor:
    """Where one slot has all the light, move one level of it to the brightest of the other slots."""
    alone = shared == levels
    others = mask.masked_fill(alone, -torch.inf)
    second = torch.zeros_like(shared).scatter_(0, others.argmax(0, keepdim=True), 1)
    return shared + torch.where(alone.any(0), second - alone.to(shared.dtype), 0)


def uniform(shape: Sequence[int], seed: int) -> torch.Tensor:
    """Return seeded float32 values, uniform in [0, 1); the same on every device and in every process."""
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))
