"""What a notebook does with the configuration in ``conf/``: what the commands do, each in one call."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sci_lightning.cli import commands
from sci_lightning.cli.composition import Composition, built, compose, group_members, plain
from sci_lightning.cli.encoder_file import adopt_encoder_files
from sci_lightning.cli.hydra_callbacks import check_folder
from sci_lightning.cli.settings import complete
from sci_lightning.cli.stored_run import with_stored_choices
from sci_lightning.console import PlainConsole, silence_libraries
from sci_lightning.errors import BadInput
from sci_lightning.runs.resume import check_nothing_lost
from sci_lightning.runs.run_folder import run_folder

if TYPE_CHECKING:
    from sci_lightning.decoder import Decoder
    from sci_lightning.studies.mask_design import DesignedMask
    from sci_lightning.studies.tables.paper_tables import Tables
    from sci_lightning.training.evaluation import Evaluation
    from sci_lightning.training.run import Run


def load_decoder(
    source: str | Path, overrides: Iterable[str] = (), *, name: str | None = None, trusted: Iterable[str] = ()
) -> Decoder:
    """Return a decoder in evaluation mode: ``decoder(measurement, mask)`` gives the video.

    It takes a linear measurement ``(N, H, W)``, light in units of full scale over the aperture, and the mask
    ``(T, H, W)`` in [0, 1]; it returns the estimate ``(N, T, H, W)``.

    >>> import torch
    >>> import sci_lightning as sci
    >>> mask = (torch.rand(8, 16, 16) < 0.5).float()
    >>> decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
    >>> tuple(decoder(torch.rand(1, 8, 16, 16).mul(mask).sum(1), mask).shape)
    (1, 8, 16, 16)
    >>> network = sci.load_decoder("res2former", ["scale=smoke"])  # weights as they start, nothing learned yet

    Args:
        source: the name of a decoder in ``conf/decoder``, whose weights come along, if it is built in their size, or
            are those that it starts with; or the path of a checkpoint, ``RUN/checkpoints/last.ckpt``; or, together
            with ``name``, that of published weights.
        overrides: of a decoder that is configured by its name: ``["frames=10", "decoder.dim=48"]``.
        name: of the decoder that published weights belong to, such as ``res2former``.
        trusted: packages beside this one whose classes a checkpoint may name.

    Raises:
        BadInput: no such decoder or file, or weights that do not fit; nothing in a file is executed.
    """
    from sci_lightning.runs.checkpoint import load_file, read_checkpoint
    from sci_lightning.weights import load_weights, shipped
    from sci_lightning.weights.published import load_published

    names = group_members("decoder")
    chosen = str(source) if str(source) in names and name is None else name
    if chosen is None:
        if not Path(source).exists():
            raise BadInput(f"{source}: no such decoder or checkpoint; choose one of {', '.join(names)}, or give a path")
        return read_checkpoint(source, trusted).decoder()
    if chosen not in names:
        raise BadInput(f"{chosen}: no such decoder; choose one of {', '.join(names)}")
    overrides = list(overrides)
    decoder: Decoder = built(compose("train", [f"decoder={chosen}", *overrides]).cfg, "decoder")
    if name is not None:
        try:
            load_published(decoder, load_file(Path(source)))
        except BadInput as error:
            raise BadInput(f"{source}: {error}") from error
    elif chosen in shipped():
        with suppress(BadInput):  # built in another size it has its first weights, as every network
            load_weights(chosen).fill("decoder", decoder)
            decoder.requires_grad_(False)
    return decoder.eval()


def train(configuration: Iterable[str] | Mapping[str, Any]) -> Run:
    """Train a mask and a decoder together, test them, and write the folder of a run, as the command ``train`` does.

    >>> import sci_lightning as sci
    >>> small = ["scale=smoke", "decoder=e2e_cnn", "metric=[psnr]", "logger=none"]
    >>> quiet = ["callbacks.progress=null", "+trainer.enable_progress_bar=false"]
    >>> run = sci.train([*small, *quiet, "trainer.accelerator=cpu", "data.scenes_count=1", "out=run"])
    2 steps ...
    >>> run.metrics.mean["psnr"] > 0  # dB, over the test scenes
    True
    >>> checkpoint = sci.load_checkpoint(run.checkpoint)
    >>> tuple(checkpoint.encoder().mask().shape)  # (T, H, W), the mask as it was learned
    (8, 32, 32)

    Args:
        configuration: overrides as on the command line, ``["encoder=lsw_sr", "size=[64,64]", "out=run"]``, or the same
            as a dictionary of plain values by setting; or a whole configuration as plain data, such as that of an
            earlier run (``metrics.config``).

    Raises:
        BadInput: an override that cannot be read or that sets what does not exist, settings that do not fit, or a
            folder ``out`` that holds another training.

    Source: the method is that of "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Sec. 3.
    """
    if isinstance(configuration, Mapping) and isinstance(configuration.get("encoder"), Mapping):
        config = dict(configuration)
        classes = {part: str(config[part]["_target_"]).rpartition(".")[2] for part in ("encoder", "decoder")}
        names = config.pop("names", classes)
    else:
        composition = _composed("train", _as_overrides(configuration))
        config, names = plain(composition.cfg), composition.names()
    out = Path(config["out"])
    check_nothing_lost(out, training=True, resume=config["resume"], ckpt_path=config["ckpt_path"])
    silence_libraries()
    # only after the settings were checked: it takes seconds
    from sci_lightning.training.run import run_training
    from sci_lightning.training.training_plan import training_plan

    with run_folder(out):
        for line in training_plan(config).lines():
            print(line)
        return run_training(config, names)


def evaluate(configuration: Iterable[str] | Mapping[str, Any]) -> Evaluation:
    """Test a trained decoder, or one that needs no training, as the command ``evaluate`` does.

    >>> import sci_lightning as sci
    >>> scenes = {"data": "synthetic", "data.scenes_count": 1, "frames": 4, "size": [32, 32]}
    >>> done = sci.evaluate({"decoder": "linear", "metric": ["psnr"], **scenes, "out": "evaluation"})
    Testing: ...
    >>> done.metrics.mean["psnr"] > 20  # dB, over the test scenes
    True

    Args:
        configuration: overrides as on the command line, ``["ckpt_path=RUN/checkpoints/last.ckpt",
            "data=six_scenes", "data.root=DIR"]``, or the same as a dictionary of plain values by setting.

    Raises:
        BadInput: overrides that cannot be read, settings or files that do not fit, or a folder ``out`` that holds a
            training.
    """
    from sci_lightning.cli.commands.evaluate import evaluation_of

    with _in_own_folder("evaluate", configuration) as composition:
        return evaluation_of(composition, PlainConsole(quiet=True))


def tables(configuration: Iterable[str] | Mapping[str, Any]) -> Tables:
    """Make the paper's tables and figures out of runs, as the command ``tables`` does.

    Args:
        configuration: overrides as on the command line, ``["runs=outputs/sweep", "out=tables"]``, or the same as a
            dictionary of plain values by setting, ``{"runs": ["outputs/a", "outputs/b"], "mosaic": 0}``.

    Raises:
        BadInput: overrides that cannot be read, settings that do not fit, or folders in which there is no run.
    """
    from sci_lightning.cli.commands.tables import tables_of

    with _in_own_folder("tables", configuration) as composition:
        if composition.cfg.documentation:
            raise BadInput("documentation=: a notebook makes tables of runs; the pages are written by the command")
        return tables_of(composition)


def design_mask(configuration: Iterable[str] | Mapping[str, Any] = ()) -> DesignedMask:
    """Find the mask behind which a linear decoder is expected to err least, as the command ``design_mask`` does.

    >>> import sci_lightning as sci
    >>> design = sci.design_mask({"size": [32, 32], "bits": 2, "steps": 5, "out": "design"})
    >>> tuple(design.mask.shape), design.score_db > design.random_start_db  # (T, H, W); dB
    ((8, 32, 32), True)

    Args:
        configuration: overrides as on the command line, ``["bits=4", "size=[256,256]"]``, or the same as a dictionary
            of plain values by setting.

    Raises:
        BadInput: overrides that cannot be read, settings out of their range, or that do not go together.
    """
    from sci_lightning.studies.mask_design import design_mask as design_and_write

    with _in_own_folder("design_mask", configuration) as composition:
        return design_and_write(plain(composition.cfg))


def command(name: str, configuration: Iterable[str] | Mapping[str, Any] = ()) -> None:
    """Do what ``python -m sci_lightning.NAME`` does: write the same files, and print the same lines.

    >>> import sci_lightning as sci
    >>> sci.command("virtual_camera", {"size": [16, 16], "dark": 1, "flat": 1, "out": "captures.h5"})
    26 captures of 16 x 16, 8 slots each, 8 bits
    ...

    Args:
        name: of any command that ``python -m sci_lightning`` lists, such as ``export_mask`` or ``captures plan``.
        configuration: overrides as on the command line, ``["ckpt_path=RUN/checkpoints/last.ckpt"]``, or the same as a
            dictionary of plain values by setting.

    Raises:
        BadInput: no such command, settings or files that do not fit, or a folder ``out`` that holds a training.
    """
    module, _, word = name.partition(" ")
    present = [file.stem for file in Path(commands.__path__[0]).glob("[a-z]*.py")]
    module = next((one for one in (module.replace(".", "_"), module.rpartition(".")[2]) if one in present), "")
    task = getattr(import_module(f"{commands.__name__}.{module}"), word or module, None) if module else None
    if task is None:
        raise BadInput(f"{name}: no such command; `python -m sci_lightning` lists them")
    with _in_own_folder(f"{module}_{word}" if word else module, configuration) as composition:
        task(composition)


@contextmanager
def _in_own_folder(command: str, configuration: Iterable[str] | Mapping[str, Any]) -> Iterator[Composition]:
    """Compose and check the configuration of a command, and take the folder that it writes."""
    composition = _composed(command, _as_overrides(configuration))
    if not composition.writes_folder:
        yield composition
        return
    out = Path(composition.cfg.out)
    check_folder(out, composition.cfg)
    with run_folder(out):
        yield composition


def _as_overrides(configuration: Iterable[str] | Mapping[str, Any]) -> list[str]:
    if isinstance(configuration, str):
        words = ", ".join(map(repr, configuration.split()))
        raise BadInput(f"{configuration}: expected a list of overrides, such as [{words}]")
    if isinstance(configuration, Mapping):
        return [f"{key}={json.dumps(value, default=str)}" for key, value in configuration.items()]
    return list(configuration)


def _composed(command: str, overrides: Iterable[str]) -> Composition:
    """Compose and check the configuration of a command; ``encoder=`` may be the path of an encoder file."""
    words = with_stored_choices(list(overrides)) if command == "train" else overrides
    return complete(compose(command, adopt_encoder_files(words)), command)
