"""Hydra is known to the commands and to ``cli/`` only, and only by what it makes public."""

from __future__ import annotations

import ast
from pathlib import Path

from hydra._internal.utils import get_args_parser

from sci_lightning.cli.command_line import hydra_options
from sci_lightning.cli.composition import compose
from sci_lightning.configuration.conf_folder import PACKAGE


def imports(path: Path) -> set[str]:
    """Return the dotted names of all modules that a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}


def test_only_the_commands_import_hydra() -> None:
    for path in PACKAGE.rglob("*.py"):
        place = path.relative_to(PACKAGE)
        if place.parts[0] == "cli":
            continue
        assert not {"hydra", "omegaconf"} & {name.partition(".")[0] for name in imports(path)}, place


def test_nothing_private_of_hydra_is_used() -> None:
    for path in PACKAGE.rglob("*.py"):
        private = [name for name in imports(path) if name.startswith(("hydra.", "omegaconf.")) and "._" in name]
        assert not private, path


def test_our_options_are_those_of_hydra() -> None:
    """A version of Hydra with another option is noticed here."""
    known, theirs = (
        {option for action in parser._actions for option in action.option_strings}
        for parser in (hydra_options("train"), get_args_parser())
    )
    assert known == theirs


def test_composing_works_anywhere_and_within_itself() -> None:
    composition = compose("train", ["encoder=rbw_sr", "decoder=e2e_cnn"])
    assert composition.choice("encoder") == "rbw_sr" and composition.choice("nothing") == "none"
    assert "hydra" not in composition.cfg and composition.cfg.size == [256, 256]
    assert "sci_lightning.encoder.effects.MaskShift" in composition.targets("effect")
