"""Strings are taken where paths are, in every function that a notebook may call."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import torch

from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.imaging.animation import write_frames, write_gif
from sci_lightning.runs.results import write_json
from sci_lightning.tables.grid import Grid

NOTEBOOK = (
    "animation.py array_file.py figures.py modulator_files.py picture_file.py results.py snapshot.py data/reader.py "
    "data/matlab.py captures/read.py captures/write.py captures/pack.py diagnosis/report.py encoder paper_tables"
)
"""Where the functions are that a notebook calls with files; the others serve the commands."""


def test_no_public_function_wants_a_path_object() -> None:
    for place in NOTEBOOK.split():
        for file in [PACKAGE / place] if place.endswith(".py") else (PACKAGE / place).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                    wanted = [each.arg for each in every if each.annotation and ast.unparse(each.annotation) == "Path"]
                    assert not wanted, (file, node.name, wanted)


def test_strings_in_the_place_of_paths(tmp_path: Path) -> None:
    video = torch.rand(1, 2, 8, 8)
    write_frames(video, f"{tmp_path}/frames")
    write_gif(video, f"{tmp_path}/video.gif")
    write_json({"a": 1}, f"{tmp_path}/a.json")
    paths = Grid("grid", "grid", ["a"], [["b"]]).write(f"{tmp_path}/grid")
    assert [path.name for path in paths] == ["grid.md", "grid.tex", "grid.png"]
    assert len(list(tmp_path.rglob("*.*"))) == 7 and np.isfinite(video).all()
