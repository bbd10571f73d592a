"""The virtual camera shares nothing with what it is to prove."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sci_lightning.virtual_camera as package

FILES = sorted(Path(package.__file__).parent.rglob("*.py"))
LIBRARIES = {"numpy", "scipy", "h5py", "skimage", "pydantic"}
SHARED = {
    "sci_lightning.captures.captures",
    "sci_lightning.errors",
    "sci_lightning.files.atomic_file",
    "sci_lightning.files.diagnosis_report",
    "sci_lightning.files.json_file",
    "sci_lightning.files.hdf5_file",
    "sci_lightning.files.mask_file",
    "sci_lightning.files.npy_file",
}
"""Captures in memory, how files are read and written, and errors; nothing of the physics."""
COMMANDS = {
    "__main__": {"sci_lightning.cli.start"},
    "reveal": {"sci_lightning.cli.start"},
}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_imports(file: Path) -> None:
    imported: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None
            imported.add(node.module)
    foreign = {name for name in imported if name.split(".")[0] not in LIBRARIES | sys.stdlib_module_names}
    foreign = {name for name in foreign if not name.startswith("sci_lightning.virtual_camera")}
    assert foreign <= SHARED | COMMANDS.get(file.stem, set())


def test_torch_is_not_even_loaded() -> None:
    seen = "import sci_lightning.virtual_camera, sys; print(sorted(set(sys.modules) & {'torch', 'lightning', 'hydra'}))"
    done = subprocess.run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
