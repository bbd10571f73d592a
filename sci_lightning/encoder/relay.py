"""The relay lens: it images the modulator's mirrors onto the sensor's pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from sci_lightning.encoder.border import TAIL, Border
from sci_lightning.encoder.footprint import blurred, image_at, image_by_parts, shares
from sci_lightning.encoder.modulator_grid import ModulatorGrid

NEWTON_STEPS = 6
"""Steps after which the inverse of a radial distortion is exact to rounding, for any in range."""
FINE_BLUR = 1.1
"""Standard deviation in mirrors of the second step of a wide blur; the first is done on the mirrors' grid. With as
much in either step, 1e-5 of the grid's repeated spectra remain: exp(-2 pi^2 a^2 b^2 / (a^2 + b^2)), a and b being
the two standard deviations."""
PARTS_AT_A_TIME = 2**18
"""Parts of pixels whose footprints are computed at a time: a field of them has 2 MiB, their shares of mirrors tens."""
DIAGONAL = 0.7
"""How much a pixel's edges nominally lean, rows to columns, from where on its parts are of the size that covers evenly:
35 degrees. At 45 degrees the image of a random binary pattern is then three times as exact, below 35 degrees less."""
TURNED_PARTS = 2
"""Least parts along either axis of a pixel that sees the mirrors turned or distorted: at 1.7 degrees the image of a
binary pattern is right to 0.0004 of its contrast as a root mean square, undivided to 0.0014."""
SMOOTH_BLUR = 1.0
"""Standard deviation in pixels from which a blur makes the image of undivided pixels as right: to 0.0004 where the
magnification changes by 2 % towards an edge (0.0005 divided and without a blur), to 0.00004 turned by two degrees."""


@dataclass(frozen=True)
class RelayGeometry:
    """Where the mask's image lies and how sharp it is; None is the nominal value.

    A mirror at m (x, y from the field's centre) is imaged to p = ``scale * R(angle) m + (dx, dy)``. x points right and
    y down; R turns x towards y: clockwise on the screen. Perspective then moves it to q with
    p = q / (1 + tilt_x q_x / (W / 2) + tilt_y q_y / (H / 2)), and the lens to q (1 + k q^2 / R^2), R being half the
    diagonal of the field. With a spread, the image is the mean of two, of ``scale (1 + spread)`` and
    ``scale (1 - spread)``.

    Attributes:
        angle: rotation, radian. scale: magnification, 1. dx, dy: displacement, pixel. sigma: standard deviation of the
            blur on the image, pixel. tilt_x, tilt_y: change of magnification from the centre to the right and to the
            lower edge, 1. k: radial distortion in the corner, 1. spread: of the magnification, 1. fill: part of a
            mirror's cell that reflects, 1. All are tensors of no dimension.
    """

    angle: torch.Tensor | None = None
    scale: torch.Tensor | None = None
    dx: torch.Tensor | None = None
    dy: torch.Tensor | None = None
    sigma: torch.Tensor | None = None
    tilt_x: torch.Tensor | None = None
    tilt_y: torch.Tensor | None = None
    k: torch.Tensor | None = None
    spread: torch.Tensor | None = None
    fill: torch.Tensor | None = None

    @property
    def colours(self) -> tuple[RelayGeometry, ...]:
        """The geometry of every colour, without a spread."""
        if self.spread is None:
            return (self,)
        scale = 1 if self.scale is None else self.scale
        return tuple(replace(self, spread=None, scale=scale * (1 + part)) for part in (self.spread, -self.spread))

    @property
    def side(self) -> torch.Tensor | float:
        """Width of a mirror as a part of their pitch."""
        return 1.0 if self.fill is None else self.fill.sqrt()

    @property
    def turned(self) -> bool:
        """Whether a pixel's footprint on the mirrors is no upright rectangle."""
        return any(value is not None for value in (self.angle, self.tilt_x, self.k))

    @property
    def smooth(self) -> bool:
        """Whether the blur is so wide that the shape of a pixel's footprint does not matter."""
        return self.sigma is not None and float(self.sigma.detach()) >= SMOOTH_BLUR

    def image(
        self,
        patterns: torch.Tensor,
        cells: int = 1,
        grid: ModulatorGrid | None = None,
        wanted: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Return the image of square mirrors, integrated over the pixels; it is dark beyond the mirrors.

        Mirrors with gaps are as bright as touching ones: all of them on are a transmittance of 1 where each is a pixel.

        The integral is exact without rotation, perspective and distortion. With them, a pixel is divided into at least
        ``TURNED_PARTS`` x ``TURNED_PARTS`` parts unless the blur is wide, and the footprint of each on the mirrors is
        taken as an upright rectangle. On a grid of their own, the mirrors are seen where they nominally lie, and the
        geometry is the deviation from there. Turned and distorted images have first derivatives only.

        Args:
            patterns: ``(P, H, W)`` transmittance of the mirrors, ``(P, Hm, Wm)`` on a grid of their own.
            cells: q, the number of cells along either axis of a pixel.
            grid: where the mirrors nominally lie; None where every mirror is a pixel.
            wanted: ``(q H, q W)`` bool, the cells that are asked for; None for all. A turned or distorted image of
                mirrors without a grid of their own is computed there only, and 0 elsewhere; any other one is whole.

        Returns:
            ``(P, q H, q W)`` transmittance that each cell sees.
        """
        if self.spread is not None:
            one, other = (colour.image(patterns, cells, grid, wanted) for colour in self.colours)
            return (one + other) / 2
        if grid is not None:
            return self._on_own_grid(patterns, cells, grid)
        if all(value is None for value in vars(self).values()):
            return patterns.repeat_interleave(cells, -1).repeat_interleave(cells, -2) if cells > 1 else patterns
        if self.turned and wanted is not None and not bool(wanted.any()):
            return patterns.new_zeros(len(patterns), *wanted.shape)
        if cells < TURNED_PARTS and self.turned and not self.smooth:
            parts = -(-TURNED_PARTS // cells)
            divided = wanted if wanted is None else wanted.repeat_interleave(parts, 0).repeat_interleave(parts, 1)
            return torch.nn.functional.avg_pool2d(self.image(patterns, parts * cells, wanted=divided), parts)
        height, width = patterns.shape[-2:]
        scale = patterns.new_ones(()) if self.scale is None else self.scale
        sigma = None if self.sigma is None or float(self.sigma.detach()) < 1e-6 else self.sigma / scale
        if self.k is not None or self.tilt_x is not None:
            return self._distorted(patterns, cells, sigma, wanted)
        y, x = _centres(height, cells, patterns), _centres(width, cells, patterns)
        y, x = self.nominal_at(y, x, (height, width), apart=True)
        pixel = 1 / (cells * scale)
        if self.angle is None:
            down = shares(y + (height - 1) / 2, sigma, pixel, height, self.side)
            return down @ patterns @ shares(x + (width - 1) / 2, sigma, pixel, width, self.side).T
        cos, sin = torch.cos(self.angle), torch.sin(self.angle)
        y, x = _selected(y[:, None], x[None], wanted)
        row = cos * y - sin * x + (height - 1) / 2
        column = cos * x + sin * y + (width - 1) / 2
        side = pixel * patterns.new_ones(())
        return _as_field(image_at(patterns, row, column, (sigma, sigma), (side, side), self.side), wanted)

    def _distorted(
        self, patterns: torch.Tensor, cells: int, sigma: torch.Tensor | None, wanted: torch.Tensor | None
    ) -> torch.Tensor:
        """Return the image if its magnification differs from place to place."""
        height, width = patterns.shape[-2:]
        y, x = _centres(height, cells, patterns)[:, None], _centres(width, cells, patterns)[None]
        y, x = _selected(y, x, wanted)
        row, column = self.nominal_at(y, x, (height, width))
        half = 0.5 / cells
        above, below = (self.nominal_at(y + side, x, (height, width))[0] for side in (-half, half))
        left, right = (self.nominal_at(y, x + side, (height, width))[1] for side in (-half, half))
        row, column = row + (height - 1) / 2, column + (width - 1) / 2
        sides = ((below - above).abs(), (right - left).abs())
        return _as_field(image_at(patterns, row, column, (sigma, sigma), sides, self.side), wanted)

    def _on_own_grid(self, patterns: torch.Tensor, cells: int, grid: ModulatorGrid) -> torch.Tensor:
        """Return the image of mirrors on a grid of their own."""
        divided = max(grid.parts, -(-TURNED_PARTS // cells) if self.turned else 1)
        sigma = self.sigma
        if sigma is not None and float(sigma.detach()) < 1e-6:
            sigma = None
        if grid.upright and not self.turned:
            return self._upright_image(patterns, cells, grid, sigma)
        lines = _centres(grid.field[0], cells, patterns.new_empty(0, dtype=torch.float64))
        steps: list[torch.Tensor | None] = [None, None]  # what the first step of a wide blur has done
        padding = [0, 0]  # mirrors beyond the edges, into which it spreads light
        if sigma is not None:
            for axis, side in zip((-2, -1), self._footprints(grid, lines, cells)[3], strict=True):
                least = (sigma * cells * side).amin()
                if float(least.detach()) > FINE_BLUR * math.sqrt(2):
                    steps[axis] = first = least.square() - FINE_BLUR**2
                    padding[axis] = more = math.ceil(5 * float(first.detach().sqrt()))
                    wider = torch.nn.functional.pad(patterns, (0, 0, more, more) if axis == -2 else (more, more))
                    patterns = blurred(wider, first.sqrt(), axis)
        images = []
        for some in lines.split(max(1, PARTS_AT_A_TIME // (divided**2 * cells * grid.field[1]))):
            row, column, size, pitch = self._footprints(grid, some, cells, divided)
            blur = [None if sigma is None else sigma * cells * divided * side for side in pitch]
            left = [
                wide if wide is None or first is None else (wide.square() - first).sqrt()
                for wide, first in zip(blur, steps, strict=True)
            ]
            places = (row + padding[0], column + padding[1])
            images.append(image_by_parts(patterns, places, (left[0], left[1]), size, divided, self.side))
        return torch.cat(images, -2)

    def _upright_image(
        self, patterns: torch.Tensor, cells: int, grid: ModulatorGrid, sigma: torch.Tensor | None
    ) -> torch.Tensor:
        """Return the image of mirrors whose rows and columns are those of the pixels, one axis after the other."""
        scale = patterns.new_ones((), dtype=torch.float64) if self.scale is None else self.scale
        y, x = (_centres(length, cells, patterns.new_empty(0, dtype=torch.float64)) for length in grid.field)
        y, x = self.nominal_at(y, x, grid.field, apart=True)
        kernels = []
        for position, (pitch, middle), length in zip((y, x), grid.axes(), grid.mirrors, strict=True):
            blur = None if sigma is None else sigma * abs(pitch) / scale
            seen = pitch * position + middle
            kernels.append(shares(seen, blur, abs(pitch) / (cells * scale), length, self.side).to(patterns))
        return kernels[0] @ patterns @ kernels[1].T

    def _footprints(
        self, grid: ModulatorGrid, lines: torch.Tensor, cells: int = 1, divided: int = 1
    ) -> tuple[torch.Tensor, torch.Tensor, tuple[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]]:
        """Return row and column of the mirrors that parts of the cells see, the size of the footprints, and the pitch.

        Every one is a field of ``(divided h, divided cells W)``, in mirrors; the pitch is how many mirrors a part is
        long. A footprint is an upright rectangle of the same variance as the part. Near 45 degrees, such rectangles
        overlap and leave gaps in a pattern to which the mirrors' edges are parallel; there they are larger, so that
        they cover evenly (exactly so at 45 degrees), and the parts draw together so that the variance of the whole
        cell stays.

        Args:
            grid: where the mirrors nominally lie.
            lines: ``(h,)`` centres of the cells' rows, in pixels from the field's centre.
            cells: along either axis of a pixel.
            divided: parts along either axis of a cell.
        """
        half = 0.5 / (cells * divided)
        offsets = _centres(1, divided, lines) / cells
        diagonal = divided > 1 and grid.leaning > DIAGONAL
        if diagonal:
            offsets = offsets * math.sqrt(max(0.0, 1 - grid.leaning**2 / (divided**2 - 1)))
        y, x = ((one[:, None] + offsets).flatten() for one in (lines, _centres(grid.field[1], cells, lines)))

        def seen(down: float, across: float) -> tuple[torch.Tensor, torch.Tensor]:
            return grid.mirror_at(*self.nominal_at(y[:, None] + down, x[None] + across, grid.field))

        below, above, right, left = seen(half, 0), seen(-half, 0), seen(0, half), seen(0, -half)
        pitch, size = [], []
        for axis in (0, 1):
            down, across = (below[axis] - above[axis]).abs(), (right[axis] - left[axis]).abs()
            larger, smaller = torch.maximum(down, across), torch.minimum(down, across)
            pitch.append((down.square() + across.square()).sqrt())
            size.append(larger + smaller.square() / larger if diagonal else pitch[-1])
        row, column = seen(0, 0)
        return row, column, (size[0], size[1]), (pitch[0], pitch[1])

    @torch.no_grad()
    def border(self, grid: ModulatorGrid) -> Border:
        """Return how far what lies beyond a modulator reaches into the field, in whole pixels from each side.

        Where the modulator's edge crosses the field, the sides are taken off that see most of what lies beyond it.
        """
        if self.spread is not None:
            one, other = (colour.border(grid) for colour in self.colours)
            return one | other
        lines = _centres(grid.field[0], 1, torch.empty(0, dtype=torch.float64))
        row, column, (high, wide), _ = self._footprints(grid, lines)
        sigma = 0.0 if self.sigma is None else TAIL * float(self.sigma)
        inside = torch.ones_like(row, dtype=torch.bool)
        for mirror, size, length in ((row, high, grid.mirrors[0]), (column, wide, grid.mirrors[1])):
            reaching = (0.5 + sigma) * size
            inside &= (mirror - reaching >= -0.5) & (mirror + reaching <= length - 0.5)
        return Border.outside(inside.numpy())

    def nominal_at(
        self, y: torch.Tensor, x: torch.Tensor, size: tuple[int, int], apart: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return where what is seen at (y, x) would nominally be seen, in pixels from the field's centre.

        Args:
            y, x: ``(h, 1)`` and ``(1, w)``, or of the same shape.
            size: (H, W) of the field.
            apart: whether y and x are ``(h,)`` and ``(w,)`` and stay so, where it neither turns nor distorts.
        """
        height, width = size
        scale = 1 if self.scale is None else self.scale
        if apart:
            return (y if self.dy is None else y - self.dy) / scale, (x if self.dx is None else x - self.dx) / scale
        y, x = torch.broadcast_tensors(y, x)
        if self.k is not None:
            far = self.k * (y.square() + x.square()) * (4 / (height**2 + width**2))
            part = torch.ones_like(far)
            for _ in range(NEWTON_STEPS):  # q = part * seen, where part + far * part**3 = 1
                step = (part + far * part**3 - 1) / (1 + 3 * far * part.square()).clamp(min=0.1)
                part = (part - step).clamp(0.5, 1.5)  # at 1.5 a barrel folds over; beyond, no mirror is seen
            y, x = y * part, x * part
        if self.tilt_x is not None and self.tilt_y is not None:
            nearer = (1 + self.tilt_x * x * (2 / width) + self.tilt_y * y * (2 / height)).clamp(min=0.1)
            y, x = y / nearer, x / nearer
        y, x = (y if self.dy is None else y - self.dy) / scale, (x if self.dx is None else x - self.dx) / scale
        if self.angle is not None:
            cos, sin = torch.cos(self.angle), torch.sin(self.angle)
            y, x = cos * y - sin * x, cos * x + sin * y
        return y, x


def _centres(length: int, cells: int, like: torch.Tensor) -> torch.Tensor:
    """Return the centres of the cells along an axis, in pixels from the field's centre, in the type of ``like``."""
    return (torch.arange(length * cells, dtype=like.dtype, device=like.device) + 0.5) / cells - length / 2


def _selected(y: torch.Tensor, x: torch.Tensor, wanted: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
    """Return places ``(h, 1)`` and ``(1, w)``; those that are ``wanted``, a field of bool, one after another."""
    return (y, x) if wanted is None else (y.expand(wanted.shape)[wanted], x.expand(wanted.shape)[wanted])


def _as_field(image: torch.Tensor, wanted: torch.Tensor | None) -> torch.Tensor:
    """Return an image ``(P, n)`` of selected places as a field, 0 elsewhere; any other one as it is."""
    if wanted is None:
        return image
    field = image.new_zeros(len(image), *wanted.shape)
    field[:, wanted] = image
    return field
