"""The frame around every command: Hydra's configuration in, one clear line out when the input is bad."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from sci_lightning.cli.console import PlainConsole
from sci_lightning.cli.continued_run import continued
from sci_lightning.cli.encoder_file import PLACES, EncoderFile, adapt_to_encoder_files, adopt_encoder_files
from sci_lightning.cli.failure_line import check_choices, check_words, exit_status, one_line, root_cause
from sci_lightning.cli.help import help_text
from sci_lightning.cli.settings_check import Refused, check_command_settings
from sci_lightning.cli.sweep import (
    Row,
    defer_to_rows,
    finished_rows,
    is_skipped,
    present_row,
    refuse_uncomposed_row,
    scores_in,
)
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import one_printable_line
from sci_lightning.runs.run_folder import is_first_process, remove_if_refused, run_folder

Task = Callable[[DictConfig], Any]


def run(name: str, task: Task) -> None:
    """Run ``task`` with the configuration ``conf/<name>.yaml`` and the overrides of the command line.

    The task finds its output folder in ``cfg.out``; a command that writes one file (``hydra/output: file``) finds that
    file there. Bad input ends the process with one line and status 2, anything unforeseen with one line and status 1;
    ``debug=true`` or ``HYDRA_FULL_ERROR=1`` show the traceback instead.

    In a multirun a row that cannot run does not stop the others, whichever launcher runs them. It ends with a table of
    all rows; its status is 0 unless a row failed, or none ran. A row whose combination does not exist, such as a binary
    mask of four bits, is skipped, which is no failure.

    ``encoder=`` and ``decoder.camera=`` take the path of a YAML file as well, which may name modules of this project
    and of ``trusted`` ones.
    """
    if {"--help", "-h"} & set(sys.argv):
        try:
            print(help_text(CONF, name, sys.argv[1:]), flush=True)
        except BrokenPipeError:  # `--help | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return
    debug = os.environ.get("HYDRA_FULL_ERROR") == "1" or "debug=true" in sys.argv
    failures: list[tuple[str, int]] = []
    told = sys.argv
    files: dict[str, EncoderFile] = {}

    def job(cfg: DictConfig) -> Any:
        in_folder = HydraConfig.get().output_subdir is not None or not is_first_process()  # else `out` is a file
        if in_folder:
            with open_dict(cfg):
                cfg.out = HydraConfig.get().runtime.output_dir
        _quieten()
        sys.argv = told  # processes that this one starts adopt the files themselves
        row = present_row()
        try:
            refuse_uncomposed_row()
            places = {place: files[chosen(place)] for place in PLACES.values() if chosen(place) in files}
            adapt_to_encoder_files(cfg, places)
            check_command_settings(cfg, name)
            os.environ["HYDRA_FULL_ERROR"] = "1" if debug else "0"  # as it was, for the processes that this one starts
            with run_folder(cfg.out) if in_folder else nullcontext():
                value = task(cfg)
        except Exception as error:
            if row is not None:
                files_of_rows, number, overrides = row
                outcome = "skipped" if is_skipped(root_cause(error)) else "failed"
                files_of_rows.write(Row(number, overrides, outcome, one_line(error), exit_status(error)))
            elif in_folder and exit_status(error) == 2:
                remove_if_refused(cfg.out, HydraConfig.get().job.name)
            if debug:
                raise
            if row is None:
                failures.append((one_line(error), exit_status(error)))
            return None
        finally:
            os.environ["HYDRA_FULL_ERROR"] = "1"
        if row is not None:
            files_of_rows, number, overrides = row
            files_of_rows.write(Row(number, overrides, "done", "", 0, scores_in(Path(cfg.get("out", "")))))
        return value

    try:
        os.environ["HYDRA_FULL_ERROR"] = "1"  # composition errors reach the lines below instead of Hydra's printer
        encoders = [path.stem for path in (CONF / "encoder").glob("*.yaml")]
        words = sorted(told[1:], key=lambda word: word not in ("-m", "--multirun"))  # wherever among the settings
        check_words(name, words)
        check_choices(words)
        arguments, earlier = continued(words, encoders) if name == "train" else (words, {})
        arguments, files = adopt_encoder_files(arguments, [*encoders, *earlier])
        files.update(earlier)
        sys.argv = [told[0], *defer_to_rows(arguments)]
        hydra.main(version_base="1.3", config_path=str(CONF), config_name=name)(job)()
    except (KeyboardInterrupt, SystemExit) as stop:
        _end_sweep(interrupted=True)
        # what Lightning makes of Ctrl-C, without a word
        if isinstance(stop, KeyboardInterrupt) or isinstance(stop.__context__, KeyboardInterrupt):
            sys.exit("interrupted")
        raise
    except (Exception, Refused) as stop:
        error = stop.__cause__ if isinstance(stop, Refused) and stop.__cause__ else stop
        if debug:
            _end_sweep()
            raise error from error.__cause__
        failures.append((one_line(error), exit_status(error)))
    finally:
        sys.argv = told
        os.environ["HYDRA_FULL_ERROR"] = "1" if debug else "0"
    failures = _end_sweep() + failures
    for line, _ in failures:
        print(f"error: {one_printable_line(line)}", file=sys.stderr)
    if failures:
        sys.exit(min(status for _, status in failures))


def _end_sweep(interrupted: bool = False) -> list[tuple[str, int]]:
    """Print the table of a sweep's rows; return a line and a status for each that failed. Nothing without a sweep."""
    rows = finished_rows()
    if not rows:
        return []
    from sci_lightning.cli.next_command import dashboard, invocation, print_next
    from sci_lightning.cli.sweep_table import row_names, sweep_table

    console = PlainConsole()
    console.print(sweep_table(rows))
    for row, name in zip(rows, row_names(rows), strict=True):
        if row.outcome == "skipped":
            console.print(f"skipped: [{name}] {row.line}")
    if interrupted:
        return []
    if any(row.scores for row in rows):
        folder = Path(HydraConfig.get().sweep.dir)
        dashboards = any(folder.glob("**/tensorboard"))
        print_next(
            console,
            invocation("tables", paths={"runs": folder}),
            *([dashboard(folder)] if dashboards else []),
        )
    failed = [(f"[{' '.join(row.overrides)}] {row.line}", row.status) for row in rows if row.outcome == "failed"]
    if unfinished := sum(row.outcome == "unfinished" for row in rows):
        failed.append((f"{unfinished} of {len(rows)} rows did not run to their end", 1))
    if not failed and all(row.outcome == "skipped" for row in rows):
        return [(f"none of the {len(rows)} rows exists: {rows[0].line}", 2)]
    return failed


def chosen(group: str) -> str:
    """Which member of a configuration group the command line or the defaults chose, such as ``lsw_sr``."""
    return str(HydraConfig.get().runtime.choices.get(group, "none"))


def member(command: str, group: str, name: str, *overrides: str) -> DictConfig:
    """A member of a configuration group as ``command`` would have it; inside a running command only."""
    return hydra.compose(command, [f"{group}={name}", *overrides])[group]


def targets(group: str) -> list[str]:
    """What the members of a configuration group build, ``hydra.searchpath`` included; inside a running command only."""
    sources = HydraConfig.get().runtime.config_sources
    folders = [Path(source.path) / group for source in sources if source.schema == "file"]
    members = [OmegaConf.load(file) for folder in folders for file in sorted(folder.glob("*.yaml"))]
    return [str(target) for member in members if (target := OmegaConf.select(member, "_target_"))]


def plain(cfg: DictConfig) -> dict[str, Any]:
    """The configuration as resolved dictionaries, lists and values, fit for JSON and checkpoints."""
    content = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    assert isinstance(content, dict)
    return {str(key): value for key, value in content.items()}


def built(cfg: DictConfig, part: str, **more: Any) -> Any:
    """Build what ``cfg`` configures under ``part``, see :func:`~sci_lightning.configuration.build.build`."""
    from sci_lightning.configuration.build import build

    node = OmegaConf.select(cfg, part)
    if not isinstance(node, DictConfig):
        raise BadInput(f"{part}={node}: expected a mapping with _target_, which names a class")
    return build(plain(node), part, **more)


def _quieten() -> None:
    """Drop what the libraries say that tells a user of a command nothing."""
    for name in ("utilities.rank_zero", "trainer.connectors.checkpoint_connector"):
        logging.getLogger(f"lightning.pytorch.{name}").setLevel(logging.WARNING)
    for message in (
        r".*does not have many workers.*",
        r".*LeafSpec.*",
        r".*module\(s\) in eval mode.*",
        r".*smaller than the logging interval.*",
        r".*Checkpoint directory .* exists and is not empty.*",
        r".*your dataloader is not resumable.*",  # TrainingPosition resumes it
    ):
        warnings.filterwarnings("ignore", message=message)
