"""Strings are taken where paths are, in every function that a notebook may call."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import torch

from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.figures.animation import write_frames, write_gif
from sci_lightning.files.json_file import write_json
from sci_lightning.studies.tables.grid import Grid

NOTEBOOK = (
    *("captures", "decoder", "diagnosis", "encoder", "figures", "metrics", "prior", "virtual_camera"),
    *("studies/benchmark", "studies/proving_ground", "studies/tables", "studies/mask_design.py"),
    *("data/video_array.py", "data/reader.py", "files/array_file.py", "files/picture_file.py"),
    *("files/modulator_files.py", "runs/results.py"),
)
"""Folders and files whose functions a notebook calls with files; the others serve the commands."""


def test_no_public_function_requires_a_path_object() -> None:
    for place in NOTEBOOK:
        files = [PACKAGE / place] if place.endswith(".py") else list((PACKAGE / place).rglob("*.py"))
        assert files, f"{place}: no such folder"
        for file in files:
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                    annotated = [argument for argument in arguments if argument.annotation]
                    strict = [word.arg for word in annotated if ast.unparse(word.annotation or word) == "Path"]
                    assert not strict, (file, node.name, strict)


def test_strings_in_the_place_of_paths(tmp_path: Path) -> None:
    video = torch.rand(1, 2, 8, 8)
    write_frames(video, f"{tmp_path}/frames")
    write_gif(video, f"{tmp_path}/video.gif")
    write_json({"a": 1}, f"{tmp_path}/a.json")
    paths = Grid("grid", "grid", ["a"], [["b"]]).write(f"{tmp_path}/grid")
    assert [path.name for path in paths] == ["grid.md", "grid.tex", "grid.png"]
    assert len(list(tmp_path.rglob("*.*"))) == 7 and np.isfinite(video).all()
