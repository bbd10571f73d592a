"""The captures in the form in which a model is compared with them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch

from sci_lightning.captures import Captures
from sci_lightning.encoder.effects import ReadNoise, ShotNoise
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.errors import BadInput

PILE_UP_SHARES = (1e-4, 1e-3, 0.01, 0.05)
"""Parts of all pixels, the brightest ones, that may have piled up at a saturation level."""
PILE_UP_WIDTH_DN = 4.0
"""DN around a saturation level that the read noise fills."""

MAX_PLAUSIBLE_LEVEL = 5.0
"""Mean level, in units of full scale, that nobody predicts who gives scenes in the units of the format."""
MIN_REFUSED_RATIO = 20.0
"""Ratio of the predicted and the measured level from which such a scene is refused."""

MAX_LIGHT = 1e6
"""Light and exposure, relative to nominal, above which a capture is refused: no session can have so much."""


@dataclass(frozen=True)
class Observation:
    """The captures whose scenes are known, sorted by their content so that their order in the file does not matter.

    Attributes:
        patterns: ``(P, H, W)`` commanded patterns of the modulator, ``(P, Hm, Wm)`` on a grid of their own.
        sequences: ``(U, T)`` the different sequences of patterns.
        sequence: ``(N,)`` which of them each capture used.
        scene: N tensors that broadcast to ``(T, H, W)``: ``(T, 1, 1)`` for an even scene, ``(1, H, W)`` at rest.
        aperture, exposure: ``(N, 1, 1)``.
        dn: ``(N, H, W)`` float32 raw DN.
        bit_depth: of the converter.
        kinds: N kinds of capture, inferred from the content, whatever the labels say.
        number: ``(N,)`` place of each capture in the file.
        read_noise, full_well: the datasheet's values in DN and electrons; None where it is silent.
        position: ``(N,)`` place of each capture in the order in which they were taken, for what depends on time;
            None if they were not taken one after the other.
        before: ``(N, H, W)`` raw DN of what was recorded just before each capture, whether its scene is known or not; 0
            before the first; None if they were not taken one after the other. Captures that are kept for verification
            are among them: no fit sees them but as what the next capture may have kept.
        verification: ``(N,)`` bool, captures that the file sets aside for verification; None where it does not say.
        grid: where the mirrors nominally lie in the field; None where every mirror is a pixel.
        dark_surround: whether no light comes from beyond the patterns; False where nobody knows what lies there.
    """

    patterns: torch.Tensor
    sequences: torch.Tensor
    sequence: torch.Tensor
    scene: list[torch.Tensor]
    aperture: torch.Tensor
    exposure: torch.Tensor
    dn: torch.Tensor
    bit_depth: int
    kinds: tuple[str, ...]
    number: torch.Tensor
    read_noise: float | None
    full_well: float | None
    position: torch.Tensor | None = None
    before: torch.Tensor | None = None
    dark_surround: bool = False
    verification: torch.Tensor | None = None
    grid: ModulatorGrid | None = None

    @property
    def full_scale(self) -> int:
        """The largest DN."""
        return int(2**self.bit_depth - 1)

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the field, in pixels."""
        return int(self.dn.shape[1]), int(self.dn.shape[2])

    @property
    def frames(self) -> int:
        """T, slots of a capture."""
        return int(self.sequences.shape[1])

    def window(self, rows: slice, columns: slice) -> Observation:
        """Return the captures of a part of the field; the patterns stay whole."""
        scene = [one[..., rows, columns] if one.shape[-1] > 1 else one for one in self.scene]
        before = None if self.before is None else self.before[:, rows, columns]
        return replace(self, scene=scene, dn=self.dn[:, rows, columns], before=before)

    def take(self, which: torch.Tensor) -> Observation:
        """Return some of the captures, ``which`` being ``(N,)`` bool."""
        places = which.nonzero()[:, 0]
        used, sequence = torch.unique(self.sequence[places], return_inverse=True)
        return replace(
            self,
            sequences=self.sequences[used],
            sequence=sequence,
            scene=[self.scene[place] for place in places.tolist()],
            aperture=self.aperture[places],
            exposure=self.exposure[places],
            dn=self.dn[places],
            kinds=tuple(self.kinds[place] for place in places.tolist()),
            number=self.number[places],
            position=None if self.position is None else self.position[places],
            before=None if self.before is None else self.before[places],
            verification=None,
        )

    @cached_property
    def pile_ups(self) -> list[float]:
        """Levels, as fractions of full scale, at which the brightest pixels may have piled up: medians of DN there."""
        bright = self.dn.flatten().sort(descending=True).values
        levels = set()
        for share in PILE_UP_SHARES:
            place = float(bright[int(share * len(bright))])
            near = bright[(bright > place - PILE_UP_WIDTH_DN) & (bright < place + PILE_UP_WIDTH_DN)]
            levels.add(float(near.median()) / self.full_scale)
        return sorted(level for level in levels if 0 < level < 1)

    @cached_property
    def target(self) -> torch.Tensor:
        """``(N,)`` number of the target of every capture: captures whose scenes are equal are of the same one."""
        contents = [
            hashlib.sha256(str(scene.shape).encode() + scene.numpy().tobytes()).digest() for scene in self.scene
        ]
        numbers = {content: number for number, content in enumerate(sorted(set(contents)))}
        return torch.tensor([numbers[content] for content in contents])

    def __len__(self) -> int:
        return len(self.dn)


def observe(captures: Captures) -> Observation:
    """Prepare the captures with known scenes for a diagnosis.

    Raises:
        BadInput: no capture with a known scene, all pixels saturated, or all black; light, exposure or datasheet values
            that no camera can have.
    """
    known = [int(n) for n in np.flatnonzero(captures.known)]
    if not known:
        raise BadInput(
            f"{captures.name}: none of the {len(captures.measurement)} captures has a known scene; a diagnosis needs "
            "captures of something known: dark frames, flat fields, single patterns, or printed or displayed scenes"
        )
    dn = captures.measurement[known]
    if (dn == 0).all() or (dn == captures.full_scale).all():
        word = "black (0 DN)" if (dn == 0).all() else f"saturated ({captures.full_scale} DN)"
        raise BadInput(f"{captures.name}: every pixel of every capture is {word}: change exposure or aperture")
    _check_values(captures, known)
    _check_levels(captures, known)
    kinds = captures.inferred_kind
    order = sorted(known, key=lambda n: (kinds[n], _digest(captures, n)))
    sequences, sequence = torch.unique(torch.from_numpy(captures.sequence[order]), dim=0, return_inverse=True)
    return Observation(
        patterns=torch.from_numpy(captures.patterns),
        sequences=sequences,
        sequence=sequence,
        scene=[_compact(captures.scene[n]) for n in order],
        aperture=torch.from_numpy(captures.aperture[order])[:, None, None],
        exposure=torch.from_numpy(captures.exposure[order])[:, None, None],
        dn=torch.from_numpy(captures.measurement[order].astype(np.float32)),
        bit_depth=captures.bit_depth,
        kinds=tuple(kinds[n] for n in order),
        number=torch.tensor(order),
        read_noise=captures.read_noise_dn,
        full_well=captures.full_well_e,
        position=torch.tensor(order),
        before=torch.stack([_recorded(captures, n - 1) for n in order]),
        dark_surround=captures.surround == "dark",
        verification=_set_aside(captures, order),
        grid=grid_of(captures),
    )


def _recorded(captures: Captures, number: int) -> torch.Tensor:
    """Return the raw DN ``(H, W)`` of a capture; 0 for those that are not in the file."""
    recorded = captures.measurement[number] if number >= 0 else np.zeros(captures.size)
    return torch.from_numpy(recorded.astype(np.float32))


def grid_of(captures: Captures) -> ModulatorGrid | None:
    """Return where the mirrors nominally lie; None where every mirror is a pixel.

    Raises:
        BadInput: patterns of another size than the field's that nobody has registered.
    """
    if captures.sensor_to_modulator is not None:
        return ModulatorGrid(captures.sensor_to_modulator, captures.size, captures.mirrors)
    if captures.mirrors != captures.size:
        raise BadInput(
            f"{captures.name}: patterns of {captures.mirrors} mirrors, a field of {captures.size} pixels (H, W), no "
            "sensor_to_modulator that says where the mirrors lie: python -m sci_lightning.captures register finds it"
        )
    return None


def _set_aside(captures: Captures, order: list[int]) -> torch.Tensor | None:
    """Return which of the captures in this order are set aside for verification; None if the file does not say."""
    if captures.verification is None:
        return None
    return torch.tensor([number in captures.verification for number in order])


def _check_values(captures: Captures, known: list[int]) -> None:
    """Refuse values that the format allows but no camera can have: predictions would overflow."""
    for number in known:
        light = float(captures.aperture[number]) * float(captures.scene[number].max())
        for what, value in (("aperture times scene", light), ("exposure", float(captures.exposure[number]))):
            if value > MAX_LIGHT:
                raise BadInput(
                    f"{captures.name}: {what} of capture {number} is {value:.3g}, expected at most {MAX_LIGHT:.0e} "
                    "(1 fills the sensor's range, or is the nominal exposure)"
                )
    datasheet = (
        ("read_noise_dn", captures.read_noise_dn, ReadNoise.about["std"]),
        ("full_well_e", captures.full_well_e, ShotNoise.about["full_well"]),
    )
    for name, stated, about in datasheet:
        if stated is not None:
            about.read(f"{captures.name}: attribute '{name}'", stated)


def _check_levels(captures: Captures, known: list[int]) -> None:
    """Refuse scenes in other units, before a search looks for an effect that dims them."""
    opening = captures.patterns.mean((1, 2), dtype=np.float64)
    lit = [n for n in known if captures.aperture[n] > 0 and captures.scene[n].any()]
    for n in lit:
        level = float(captures.aperture[n]) * float(opening[captures.sequence[n]] @ captures.scene[n].mean((1, 2)))
        measured, saturated = captures.measurement[n], (captures.measurement[n] == captures.full_scale).mean()
        part = float(measured.mean()) / captures.full_scale
        if level > MAX_PLAUSIBLE_LEVEL and level > MIN_REFUSED_RATIO * part and saturated < 0.5:
            raise BadInput(
                f"{captures.name}: scene and aperture of capture {n} predict {level:.3g} times full scale, {part:.2g} "
                "was measured; a scene of 1 fills the sensor's range: is it in DN or percent?"
            )


def _digest(captures: Captures, n: int) -> str:
    """Return a digest over the content of one capture."""
    content = (captures.sequence[n], captures.aperture[n], captures.exposure[n], captures.measurement[n])
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in content)).hexdigest()


def _compact(scene: np.ndarray) -> torch.Tensor:
    """Return a scene without its repetitions in space or time."""
    if (scene == scene[:, :1, :1]).all():
        scene = scene[:, :1, :1]
    elif (scene == scene[:1]).all():
        scene = scene[:1]
    return torch.from_numpy(np.ascontiguousarray(scene))
