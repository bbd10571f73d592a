"""The frame around every command: Hydra's configuration in, one clear line out when the input is bad."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from sci_lightning.cli.command_line import check_choices, check_words
from sci_lightning.cli.composition import Composition, from_hydra, in_sweep, search_path_checked, store_defaults
from sci_lightning.cli.encoder_file import adopt_encoder_files
from sci_lightning.cli.failure_line import exit_status, one_line
from sci_lightning.cli.help import help_text
from sci_lightning.cli.hydra_callbacks import CommandFailed
from sci_lightning.cli.settings import complete
from sci_lightning.cli.stored_run import with_stored_choices
from sci_lightning.cli.sweep import defer_to_rows, finished_rows, refuse_uncomposed_row
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.console import silence_libraries, warn
from sci_lightning.errors import INTERRUPTED, BadInput, InputWarning
from sci_lightning.plain_text import one_printable_line
from sci_lightning.runs.run_folder import is_first_process, run_folder, undo_if_refused

Task = Callable[[Composition], Any]
"""What a command does with the composition of its ``conf/COMMAND.yaml``."""


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
        print(help_text(CONF, name, sys.argv[1:]))
        return
    debug = os.environ.get("HYDRA_FULL_ERROR") == "1" or "debug=true" in sys.argv
    warnings.showwarning = _show_warning
    failed: list[tuple[str, int]] = []
    interrupted = False
    try:
        words = sorted(sys.argv[1:], key=lambda word: word not in ("-m", "--multirun"))  # wherever among the settings
        store_defaults()
        arguments = _hydra_arguments(name, words)
        job = job_of(name, task, debug)
        with _process_state([sys.argv[0], *arguments], full_errors=True), search_path_checked():
            hydra.main(version_base="1.3", config_path=str(CONF), config_name=name)(job)()
    except (KeyboardInterrupt, SystemExit) as stop:
        interrupted = True
        # what Lightning makes of Ctrl-C, without a word
        if isinstance(stop, KeyboardInterrupt) or isinstance(stop.__context__, KeyboardInterrupt):
            print("interrupted", file=sys.stderr)
            sys.exit(INTERRUPTED)
        raise
    except (Exception, CommandFailed) as stop:
        error = stop.__cause__ if isinstance(stop, CommandFailed) and stop.__cause__ else stop
        if debug or isinstance(error, BrokenPipeError):  # of which start() makes a quiet end
            raise error from error.__cause__
        failed.append((one_line(error), exit_status(error)))
        if isinstance(error, BadInput):  # a sweep that its launcher refuses: none of its rows has begun
            finished_rows()
    finally:
        failed = _end_sweep(interrupted) + failed
    for line, _ in failed:
        print(f"error: {one_printable_line(line)}", file=sys.stderr)
    if failed:
        sys.exit(min(status for _, status in failed))


def _hydra_arguments(name: str, words: Sequence[str]) -> list[str]:
    """Check the words of a command line and translate what Hydra does not know: files of encoders, runs to go on with.

    Raises:
        BadInput: a word that is no setting or option, or a file that cannot be used.
    """
    check_words(name, words)
    check_choices(words)
    return defer_to_rows(adopt_encoder_files(with_stored_choices(words) if name == "train" else words))


def job_of(name: str, task: Task, debug: bool = False) -> Callable[[DictConfig], Any]:
    """Return what Hydra calls, once or for every row of a sweep: take the folder, run the task."""
    words = sys.argv

    def job(cfg: DictConfig) -> Any:
        settings = HydraConfig.get()
        in_folder = settings.output_subdir is not None or not is_first_process()  # else `out` is a file
        if in_folder:
            with open_dict(cfg):
                cfg.out = settings.runtime.output_dir
        silence_libraries()
        composition = from_hydra(cfg, settings)
        try:
            if in_sweep():  # of a single run, before Hydra made its folder
                refuse_uncomposed_row(settings)
                composition = complete(composition, name, row=True)
            # processes that this one starts begin with the command line that this one was started with
            alone = in_folder and cfg.get("job") is None  # jobs share the folder of their sweep
            folder = run_folder(cfg.out, wait=bool(cfg.get("resume")) and in_sweep()) if alone else nullcontext()
            with _process_state(words, full_errors=debug), folder:
                return task(composition)
        except Exception as error:
            if in_sweep():
                if debug:
                    traceback.print_exc()
                raise  # SweepRows makes a row of it, and the others go on
            if in_folder and exit_status(error) == 2:
                undo_if_refused(cfg.out, settings.job.name)
            raise CommandFailed from error

    return job


@contextmanager
def _process_state(argv: Sequence[str], full_errors: bool) -> Iterator[None]:
    """Set, for a while, what ``hydra.main`` reads of the process: it takes neither of the two as an argument.

    Args:
        argv: the program and its arguments.
        full_errors: whether Hydra raises the errors of composing and running; else it prints them and exits.
    """
    before = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv, os.environ["HYDRA_FULL_ERROR"] = list(argv), "1" if full_errors else "0"
    try:
        yield
    finally:
        sys.argv = before[0]
        os.environ.pop("HYDRA_FULL_ERROR")
        if before[1] is not None:
            os.environ["HYDRA_FULL_ERROR"] = before[1]


def _end_sweep(interrupted: bool) -> list[tuple[str, int]]:
    """Print the table of a sweep's rows; return a line and a status for each that failed. Nothing without a sweep."""
    rows = finished_rows()
    if not rows:
        return []
    from sci_lightning.cli.sweep_summary import failures, print_summary

    print_summary(rows, interrupted)
    return [] if interrupted else failures(rows)


_show_others = warnings.showwarning


def _show_warning(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
    """Print a warning about the user's input as one line, and any other as Python does."""
    if issubclass(category, InputWarning):
        warn(str(message))
    else:
        _show_others(message, category, *place, **more)
