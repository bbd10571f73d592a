"""The virtual camera shares nothing with what it is to prove."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sci_lightning.virtual_camera as package

FILES = sorted(Path(package.__file__).parent.rglob("*.py"))
LIBRARIES = {"numpy", "scipy", "h5py", "skimage"}
OWN = {
    "sci_lightning.errors",
    "sci_lightning.files.atomic_file",
    "sci_lightning.files.hdf5_file",
    "sci_lightning.files.npy_file",
}
"""How files are read and written, and errors; nothing of the physics."""
PRINTING = {
    "sci_lightning.cli.console",
    "sci_lightning.cli.next_command",
    "sci_lightning.files.plain_text",
    "rich.table",
}
READING = {"sci_lightning.files.json_fields"}
COMMANDS = {
    "__main__": {"sci_lightning.cli.command", "sci_lightning.cli.composition", *PRINTING},
    "reveal": PRINTING | READING,
}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_imports(file):
    imported = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            imported.add(node.module)
    foreign = {name for name in imported if name.split(".")[0] not in LIBRARIES | sys.stdlib_module_names}
    foreign = {name for name in foreign if not name.startswith("sci_lightning.virtual_camera")}
    assert foreign <= OWN | COMMANDS.get(file.stem, set())


def test_torch_is_not_even_loaded():
    seen = "import sci_lightning.virtual_camera, sys; print(sorted(set(sys.modules) & {'torch', 'lightning', 'hydra'}))"
    done = subprocess.run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
