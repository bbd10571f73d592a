"""The start of a command, which loads nothing before Ctrl-C can end it without a traceback, and its quiet end."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec


@contextmanager
def output_may_be_cut_off() -> Iterator[None]:
    """End the process quietly, with status 1 as rich has it, once nobody reads its output, as in ``COMMAND | head``."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the interpreter flushes again at its exit
        sys.exit(1)


def command_module(command: str) -> str:
    """Return the module of a command: that of its name, or of what stands before its first underscore."""
    commands = "sci_lightning.cli.commands"
    return f"{commands}.{command if find_spec(f'{commands}.{command}') else command.partition('_')[0]}"


def start(command: str) -> None:
    """Load a command of ``cli/commands`` and run it; while it loads, Ctrl-C ends the process without a word.

    What runs is the function of the command's name; ``main`` of its file where the words of the command line, or what
    there is to choose from, need more than Hydra does.
    """
    mine = signal.getsignal(signal.SIGINT) == signal.default_int_handler  # else somebody ignores it, or handles it
    if mine:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    module, run = import_module(command_module(command)), import_module("sci_lightning.cli.command").run
    if mine:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    with output_may_be_cut_off():
        if hasattr(module, "main"):
            module.main()
        else:
            run(command, getattr(module, command))
