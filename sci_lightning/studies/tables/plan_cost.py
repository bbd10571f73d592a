"""What rows of the tables take on other devices: steps, examples, hours and memory, counted, at rates measured there.

Nothing is trained or measured here; ``train dry_run=true`` measures a step of one row on this machine.
"""

from __future__ import annotations

import math
import re
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.decoder.tiling.memory import kept_for_gradients
from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.rows import TableRow
from sci_lightning.training.step_cost import BEYOND_ACTIVATIONS, PER_PARAMETER
from sci_lightning.training.training_length import counted_steps, most_seconds, source_of
from sci_lightning.training.training_plan import TrainingPlan


@dataclass(frozen=True)
class Rate:
    """How fast a device trained a network, in bfloat16 with float32 weights.

    Attributes:
        decoder: the network's name.
        macs: multiply-accumulates of decoding one of its clips.
        operations: a second, 6 for each multiply-accumulate of a clip, of all trainings on the device together.
    """

    decoder: str
    macs: float
    operations: float


RATES = {
    "core": (
        Rate("e2e_cnn", 3.34e9, 374e9),
        Rate("revsci", 2.81e9, 276e9),
        Rate("stformer", 4.93e9, 209e9),
        Rate("birnat", 5.46e9, 185e9),
        Rate("sci3d", 4.01e9, 190e9),
        Rate("elp_unfolding", 1.37e9, 204e9),
        Rate("metasci", 0.414e9, 229e9),
        Rate("res2former", 0.620e9, 65.3e9),
        Rate("res2former_l", 0.655e9, 28.1e9),
        Rate("res2former", 54.0e9, 267e9),
    ),
    "h100": (
        Rate("e2e_cnn", 53.5e9, 144e12),
        Rate("e2e_cnn", 3.34e9, 39.8e12),
        Rate("revsci", 2.81e9, 19.0e12),
        Rate("res2former", 0.62e9, 3.17e12),
    ),
}
"""Rates by device. ``core``: a core of an AMD EPYC that multiplies bfloat16, of the first rows in
``docs/results/tables/cpu`` (RBw/oSR, of Res2former LSw/SR with 4 bits), the last half of what two threads reach in
``docs/results/benchmark/training_res2former.json``. ``h100``: an NVIDIA H100 kept busy by several trainings; E2E-CNN at
256 x 256 pixels by four (as in ``docs/results/tables/gpu30_7_minutes``), 64 x 64 by sixteen
(``docs/results/cuda-graph.json``)."""

ALIKE = 10.0
"""Times more or less work a clip with which a rate still holds: smaller clips and narrower networks are slower."""


def rate(device: str, decoder: str, macs: float) -> float:
    """Return the operations a second that a device is expected to reach.

    It is the median of what was measured at about as much work a clip, with this decoder or else with any; else what
    was measured at the most similar amount of work.

    Args:
        device: of :data:`RATES`.
        decoder: its name.
        macs: multiply-accumulates of decoding a clip.
    """

    def distance(measured: Rate) -> float:
        return abs(math.log(measured.macs / macs))

    alike = [measured for measured in RATES[device] if distance(measured) <= math.log(ALIKE)]
    own = [measured for measured in alike if measured.decoder == decoder]
    nearest = min(RATES[device], key=distance)
    return statistics.median(measured.operations for measured in own or alike or [nearest])


def row_plan(decoder: str, config: Mapping[str, Any], device: str, count: int = 1) -> TrainingPlan:
    """Return the size of a row's training, and what it takes on devices that divide each batch among themselves.

    Args:
        decoder: its name.
        config: ``conf/train.yaml``, composed and plain; ``data.root`` may be missing.
        device: of :data:`RATES`.
        count: of devices.

    Raises:
        BadInput: settings that leave no step.
    """
    known = config["data"].get("clips_per_epoch")
    clips, per_epoch, steps = counted_steps(config, None if known else source_of(config))
    with torch.device("meta"):
        network = build(config["decoder"], "decoder")
    height, width = config["crop"]
    macs, batch = count_macs(network, config["frames"], height, width), config["batch_size"]
    precision = str(config["trainer"]["precision"])
    kept = kept_for_gradients(network.train(), config["frames"], (height, width), not precision.startswith("32"))
    return TrainingPlan(
        clips,
        per_epoch,
        steps,
        batch,
        step_seconds=6 * macs * batch / (rate(device, decoder, macs) * count),
        device=f"{count} x {device}, {precision}",
        memory=math.ceil(batch / count) * BEYOND_ACTIVATIONS * kept + PER_PARAMETER * count_parameters(network),
        core_minutes=config["core_minutes"],
        most_seconds=most_seconds(config["trainer"]),
    )


def cost_table(rows: Sequence[TableRow], config_of: Callable[[TableRow], Mapping[str, Any]], devices: str) -> Grid:
    """Return a line for every row: steps, examples, hours and memory of a training; what all take stands below.

    Args:
        rows: to be trained, one for each seed.
        config_of: returns the composed, plain configuration of a row; asked once for each decoder.
        devices: how many of which kind divide each batch among themselves, such as ``8xh100`` or ``1xcore``.

    Raises:
        BadInput: other devices, or settings that leave no step.
    """
    match = re.fullmatch(r"([1-9]\d{0,5})x(\w+)", devices)
    if match is None or match[2] not in RATES:
        raise BadInput(f"devices={devices}: expected a number and a kind, {' or '.join(f'8x{one}' for one in RATES)}")
    count, device = int(match[1]), match[2]
    seeds = Counter(row.name for row in rows)
    plans: dict[str, TrainingPlan] = {}
    cells, hours = [], 0.0
    for row in rows:
        if row.seed:
            continue
        if row.decoder not in plans:
            plans[row.decoder] = row_plan(row.decoder, config_of(row), device, count)
        plan, number = plans[row.decoder], seeds[row.name]
        hours += number * plan.seconds / 3600
        figures = (row.bits, number, plan.expected_steps, plan.expected_steps * plan.batch_size)
        taken = (f"{plan.seconds / 3600:.3g}", f"{plan.memory / 1e9:.3g}")
        cells.append([row.encoder, row.decoder, *(f"{figure:,}" for figure in figures), *taken])
    heading = ["encoder", "decoder", "bits", "seeds", "steps", "examples", "hours", "GB"]
    notes = [
        f"Of one seed each, on {count} x {device}; memory of one of them. {len(rows)} trainings: {hours:,.3g} hours, "
        f"{hours * count:,.3g} of a device. Tests come on top.",
        "Rates were measured in bf16-mixed, with the device kept busy: a training by itself takes longer, and so does "
        "precision=32. Networks that were not measured are taken to be as fast as others of as much work.",
    ]
    return Grid("plan_cost", "What the rows would take", heading, cells, notes)
