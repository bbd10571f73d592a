"""Does the misfit follow slots and patterns, the edges and copies of the image, or single captures and their order?"""

from __future__ import annotations

from collections.abc import Callable

import torch
from scipy.stats import chi2
from scipy.stats import f as fisher

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, Regression, test_scores
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

MAX_DELAY_SLOTS = 8
"""Delay up to which patterns are looked for."""
EDGE_CHANGES = ("right", "down", "turn", "larger", "wider", "skew", "blur")
"""Displacement to the right and down; what is turned clockwise, larger, wider and lower, or skewed moves by so much at
the middle of the field's edges; half the squared width of a blur."""
SHOWN_DISPLACEMENT_PIXELS = 32
"""Displacement up to which the correlation with the picture is drawn; all displacements are tested."""
FREQUENCY_RINGS = 16
"""Rings of spatial frequency."""
DRIFT_DEGREE = 3
"""A drift is a polynomial of this degree in the number of the capture."""
CARRY_OVER_CAPTURES = 3
"""Captures back to which a remainder is looked for."""


def slots(residuals: Residuals) -> Answer:
    """Regress the residual on the light of every slot, without what all slots have in common."""
    observation = residuals.observation
    regression = Regression(observation.frames)
    for n, scene in enumerate(observation.scene):
        light = residuals.masks[observation.sequence[n]] * scene * observation.aperture[n] * residuals.sensitivity[n]
        regression.add(light, residuals.scaled[n])
    names = tuple(str(slot + 1) for slot in range(observation.frames))
    return regression.centred().answer(names, "slot", "part of the slot's light")


def delays(residuals: Residuals) -> Answer:
    """Regress the residual on the change of a moving scene when patterns come late, or stay on, by 0, 1, .. slots."""
    observation = residuals.observation
    late = min(observation.frames, MAX_DELAY_SLOTS)
    regression = Regression(late)
    for n, scene in enumerate(observation.scene):
        if len(scene) > 1:
            motion = scene - scene.mean(0)
            shown = residuals.masks[observation.sequence[n]]
            light = torch.stack([(shown.roll(delay, 0) * motion).sum(0) for delay in range(late)])
            regression.add(light * observation.aperture[n] * residuals.sensitivity[n], residuals.scaled[n])
    return regression.answer(tuple(map(str, range(late))), "slots late", "part of the light")


def patterns(residuals: Residuals) -> Answer:
    """Regress the residual on every pattern's image, with the light of the slots in which a pattern is commanded."""
    return _pattern_answer(residuals, lambda scene: scene)


def swaps(residuals: Residuals) -> Answer:
    """Do the same with the changing part of a moving scene, which shows in which slot a pattern is displayed."""
    return _pattern_answer(residuals, lambda scene: scene - scene.mean(0))


def _pattern_answer(residuals: Residuals, part: Callable[[torch.Tensor], torch.Tensor]) -> Answer:
    """Correlate the residual with every pattern displayed (column) while a pattern is commanded (row).

    Args:
        residuals: of a fit.
        part: of the scene ``(T, H, W)`` that is looked at.
    """
    observation, images = residuals.observation, residuals.images.flatten(1)
    count, size = len(images), residuals.raw.shape[1:]
    total = torch.zeros(count, count, dtype=torch.float64)
    squares = torch.zeros_like(total)
    for n, scene in enumerate(observation.scene):
        commanded = observation.sequences[observation.sequence[n]]
        light = part(scene).expand(len(commanded), *size).contiguous()
        shone = torch.zeros(count, *size).index_add_(0, commanded, light)
        shone = shone[used := commanded.unique()]
        product = (shone * observation.aperture[n] * residuals.sensitivity[n] * residuals.scaled[n]).flatten(1)
        total[used] += (product @ images.T).double()
        squares[used] += (product.square() @ images.square().T).double()
    scores = torch.where(squares > 0, total / squares.sqrt(), torch.nan)
    picture = Picture("map", scores, axes=("pattern that light came through", "commanded pattern"))
    return test_scores(scores, picture, dependent=True)


def mask_edges(residuals: Residuals) -> Answer:
    """Regress the residual on displacements and a blur of the mask's image, with the scene where it is."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        masks, scene = residuals.masks[observation.sequence[n]], observation.scene[n]
        return (masks.sum(0, keepdim=True) if len(scene) == 1 else masks), scene  # at rest: the masks may be added up

    return _edge_answer(residuals, light)


def image_edges(residuals: Residuals) -> Answer:
    """Regress the residual on displacements and a blur of the whole picture."""
    observation = residuals.observation

    def light(n: int) -> tuple[torch.Tensor, torch.Tensor]:
        return (residuals.masks[observation.sequence[n]] * observation.scene[n]).sum(0, keepdim=True), torch.ones(
            1, 1, 1
        )

    return _edge_answer(residuals, light)


def _edge_answer(residuals: Residuals, light: Callable[[int], tuple[torch.Tensor, torch.Tensor]]) -> Answer:
    """Regress on displacements of one factor of the light.

    Args:
        residuals: of a fit.
        light: for a capture's number, fields ``(T, H, W)`` that are moved, and fields that they are multiplied with.
    """
    height, width = residuals.observation.size
    y = torch.linspace(-1, 1, height)[:, None]
    x = torch.linspace(-1, 1, width)[None]
    regression = Regression(len(EDGE_CHANGES))
    for n, residual in enumerate(residuals.scaled):
        moved, fixed = light(n)
        right, down, blur = (
            (derivative * fixed).sum(0) * residuals.sensitivity[n] * residuals.observation.aperture[n]
            for derivative in _derivatives(moved)
        )
        # what moves by (u, v) changes by u * right + v * down
        turn, larger = x * down - y * right, x * right + y * down
        wider, skew = x * right - y * down, y * right + x * down
        regression.add(torch.stack((right, down, turn, larger, wider, skew, blur)), residual)
    return regression.answer(EDGE_CHANGES, "of the edges", "pixel (blur: pixel²)")


def _derivatives(field: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the change of a field ``(T, H, W)`` for a pixel to the right, a pixel down, and a unit of sigma**2 / 2."""
    far = torch.nn.functional.pad(field, (1, 1, 1, 1), mode="replicate")
    left, right = far[..., 1:-1, :-2], far[..., 1:-1, 2:]
    above, below = far[..., :-2, 1:-1], far[..., 2:, 1:-1]
    return (left - right) / 2, (above - below) / 2, left + right + above + below - 4 * field


def copies(residuals: Residuals) -> Answer:
    """Correlate the residual with the predicted picture over all displacements: reflections, tails, a second image.

    What is proportional to the picture itself is removed first: it is a matter of gain.
    """
    height, width = residuals.observation.size
    total, squares = torch.zeros(height, width), 0.0
    for mean, weight, residual in zip(residuals.prediction.mean, residuals.sensitivity, residuals.scaled, strict=True):
        picture = mean - mean.mean()
        size = float(picture.square().sum())
        if size == 0 or not weight.any():
            continue
        picture = picture * weight.mean()
        left = residual - residual.mean()
        left = left - picture * (left * picture).sum() / picture.square().sum()
        total += torch.fft.irfft2(torch.fft.rfft2(left) * torch.fft.rfft2(picture).conj(), s=(height, width))
        squares += float(picture.square().sum())
    scores = torch.fft.fftshift(total / max(squares, 1e-30) ** 0.5)
    top, left_edge = height // 2, width // 2
    rows = slice(max(0, top - SHOWN_DISPLACEMENT_PIXELS), top + SHOWN_DISPLACEMENT_PIXELS + 1)
    columns = slice(max(0, left_edge - SHOWN_DISPLACEMENT_PIXELS), left_edge + SHOWN_DISPLACEMENT_PIXELS + 1)
    shown = scores[rows, columns]
    up, aside = top - rows.start, left_edge - columns.start
    extent = (-aside - 0.5, shown.shape[1] - aside - 0.5, shown.shape[0] - up - 0.5, -up - 0.5)
    image = Picture("map", shown, axes=("displaced to the right (pixel)", "displaced down (pixel)"), extent=extent)
    return test_scores(scores, image, dependent=True)


def frequency(residuals: Residuals) -> Answer:
    """Test the power of the residuals in rings of spatial frequency, which is even for noise, whatever its strength.

    Source: Bartlett, Proc. R. Soc. A 160, 268 (1937), for the equality of variances.
    """
    field, rings = residuals.scaled, FREQUENCY_RINGS
    count, height, width = field.shape
    amplitude = torch.fft.rfft2(field)
    power = (amplitude.real.square() + amplitude.imag.square()).sum(0).double() / (height * width)
    half = torch.full((width // 2 + 1,), 2.0, dtype=torch.float64)  # stands for its mirror image too
    half[0] = 1
    if width % 2 == 0:
        half[-1] = 1
    freedom = half.expand(height, -1).clone() * count
    freedom[0, 0] = 0  # the mean is no matter of frequency
    across = torch.fft.rfftfreq(width)[None]
    down = torch.fft.fftfreq(height)[:, None]
    radius = torch.hypot(across, down).flatten()
    order = radius.argsort()
    ring = torch.empty_like(order)
    ring[order] = (freedom.flatten()[order].cumsum(0) / freedom.sum().clamp(min=1) * rings).long().clamp(max=rings - 1)
    total, size = (
        torch.bincount(ring, values.flatten(), minlength=rings) for values in (power * (freedom / count), freedom)
    )
    place = torch.bincount(ring, radius.double() * freedom.flatten(), minlength=rings) / size.clamp(min=1)
    kept = size >= 8
    total, size, place = total[kept], size[kept], place[kept]
    picture = Picture(
        "curve",
        total / size,
        unit="power (1 = noise)",
        x=tuple(place.tolist()),
        axes=("spatial frequency (cycles per pixel)",),
        errors=(2 / size).sqrt(),
        middle=1.0,
    )
    if len(size) < 2 or total.sum() <= 0:
        return Answer(0.0, 1.0, 0.0, picture)
    mean = total.sum() / size.sum()
    statistic = -float((size * (total / size / mean).clamp(min=1e-30).log()).sum())
    statistic /= float(1 + ((1 / size).sum() - 1 / size.sum()) / (3 * (len(size) - 1)))
    freedom_left = len(size) - 1
    nats = max(0.0, statistic - freedom_left) / 2
    return Answer(statistic, float(chi2.sf(statistic, freedom_left)), nats, picture)


def kinds(residuals: Residuals) -> Answer:
    """Test the mean residual of every kind of capture."""
    names = tuple(sorted(set(residuals.observation.kinds)))
    members = [torch.tensor([kind == name for kind in residuals.observation.kinds]) for name in names]
    count = torch.tensor([residuals.raw[member].numel() for member in members]).double()
    mean = torch.stack([residuals.scaled[member].mean(dtype=torch.float64) for member in members])
    picture = Picture("bars", mean, unit="mean residual (σ)", x=names, axes=("kind",), errors=count.rsqrt())
    return test_scores(mean * count.sqrt(), picture)


def captures(residuals: Residuals) -> Answer:
    """Test the excess light of every capture, relative to its own; without light the mean residual."""
    values, errors = _excess_light(residuals)
    scores = torch.zeros_like(values)
    scores[residuals.observation.number.argsort().argsort()] = values / errors
    numbers = tuple(str(n) for n in residuals.observation.number.sort().values.tolist())
    return test_scores(scores, Picture("bars", scores, x=numbers, axes=("capture, as in the file",)))


def drift(residuals: Residuals) -> Answer:
    """Test whether the light changes smoothly from capture to capture, beyond what captures differ by anyway.

    Captures without light are left out.
    """
    values, errors = _excess_light(residuals)
    lit = torch.tensor([bool(mean.mean() > 1) for mean in residuals.prediction.mean])
    number, values, errors = residuals.observation.number[lit].double(), values[lit], errors[lit]
    order = number.argsort()
    picture = Picture(
        "curve",
        100 * values[order],
        unit="excess light (%)",
        x=tuple(number[order].tolist()),
        axes=("capture, as in the file",),
        errors=100 * errors[order],
    )
    left = len(values) - DRIFT_DEGREE - 1
    if left < 1:
        return Answer(0.0, 1.0, 0.0, picture)
    place = 2 * (number - number.min()) / (number.max() - number.min()) - 1
    basis = torch.stack([place**power for power in range(DRIFT_DEGREE + 1)], 1) / errors[:, None]
    scores = values / errors
    orthogonal = torch.linalg.qr(basis).Q
    along = orthogonal.T @ scores
    rest = float((scores - orthogonal @ along).square().sum())
    trend = float(along[1:].square().sum())
    statistic = trend / DRIFT_DEGREE / max(1.0, rest / left)
    nats = max(0.0, trend - DRIFT_DEGREE) / 2
    return Answer(statistic, float(fisher.sf(statistic, DRIFT_DEGREE, left)), nats, picture)


def _excess_light(residuals: Residuals) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the excess light ``(N,)`` as a part of the capture's own (of 1 without any), and its standard errors."""
    light = residuals.prediction.mean / residuals.observation.full_scale * residuals.sensitivity
    lit = (light.square().sum((1, 2)) > 0)[:, None, None]
    light = torch.where(lit, light, 1.0).double()
    weight = light.square().sum((1, 2))
    return (light * residuals.scaled).sum((1, 2)) / weight, weight.rsqrt()


def carry_over(residuals: Residuals) -> Answer:
    """Regress the residual on the pictures of earlier captures, without what resembles the capture's own picture."""
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    place = {number: n for n, number in enumerate(residuals.observation.number.tolist())}
    regression = Regression(CARRY_OVER_CAPTURES)
    for number, n in place.items():
        weight = residuals.sensitivity[n]
        own = torch.linalg.qr(torch.stack((weight, weight * pictures[n]), -1).flatten(0, 1)).Q
        changes = torch.zeros(CARRY_OVER_CAPTURES, *weight.shape)
        for later in range(1, CARRY_OVER_CAPTURES + 1):
            if number - later in place:
                before = (pictures[place[number - later]] * weight).flatten()
                changes[later - 1] = (before - own @ (own.T @ before)).reshape(weight.shape)
        regression.add(changes, residuals.scaled[n])
    names = tuple(str(later) for later in range(1, CARRY_OVER_CAPTURES + 1))
    return regression.answer(names, "captures later", "part that remains")
