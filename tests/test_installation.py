"""What the Makefile installs, and with which versions: what a training needs and no more; the rest for the tests."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests.conftest import ROOT
from tests.documentation.pages import SMALL, SMALL_DECODER

if sys.version_info >= (3, 11):
    import tomllib
else:
    tomllib = pytest.importorskip("tomli")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
TOOLS = ("pytest", "mypy", "ruff", "hypothesis", "onnx", "onnxruntime", "onnxscript", "deepinv", "torchvision", "av")
TOOLS += ("hydra_plugins", "joblib", "submitit", "xdist", "build", "hatchling")
"""Modules that only tests, linters and some commands need."""
BUILT_FOR_MACHINES = ("torch", "torchvision")
"""Packages that the lock leaves out."""


def recipe(target: str) -> list[str]:
    """Return the commands that ``make`` would run in a fresh clone."""
    make = ["make", "--dry-run", "--always-make", "-C", str(ROOT), target]
    return subprocess.run(make, capture_output=True, text=True, check=True).stdout.splitlines()


def pins(path: str) -> dict[str, str]:
    """Return the pinned versions of a file of requirements, by normalised name."""
    lines = re.findall(r"^([A-Za-z][\w.-]*)==([^\s;\\]+)", (ROOT / path).read_text(), re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in lines}


@pytest.mark.parametrize(
    "target", ["train", "diagnose", "tables", "smoke-tables", "speedrun", "benchmark", "documentation"]
)
def test_commands_install_what_they_need(target: str) -> None:
    lines = recipe(target)
    assert any(line.endswith("--editable .") for line in lines) and not any("[dev]" in line for line in lines)


@pytest.mark.parametrize("target", ["test", "lint"])
def test_tests_and_linters_install_the_rest(target: str) -> None:
    lines = recipe(target)
    places = [next(n for n, line in enumerate(lines) if word in line) for word in ("--editable .", "[dev]", "ruff")]
    assert places == sorted(places)


def test_a_training_does_without_the_tools(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refuse = f"import sys\nfor name in {TOOLS}:\n    sys.modules[name] = None\n"
    (tmp_path / "without").mkdir()
    (tmp_path / "without" / "sitecustomize.py").write_text(refuse)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path / 'without'}:{ROOT}")
    small = [*SMALL, *SMALL_DECODER["e2e_cnn"], "data.scenes_count=1", "mask_start=published", "out=run"]
    train = [sys.executable, "-m", "sci_lightning.train", "experiment=quickstart", *small]
    done = subprocess.run(train, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and (tmp_path / "run" / "metrics.json").is_file(), done.stderr


def test_pinned_versions_fit_the_requirements() -> None:
    pinned = pins("constraints.txt")
    extras = [line for lines in PROJECT["optional-dependencies"].values() for line in lines]
    for requirement in map(Requirement, (*PROJECT["dependencies"], *extras)):
        version = pinned.get(re.sub(r"[-_.]+", "-", requirement.name).lower())
        assert version is None or requirement.specifier.contains(version), f"{requirement}: pinned to {version}"
    (hydra,) = (one for one in map(Requirement, PROJECT["dependencies"]) if one.name == "hydra-core")
    assert not hydra.specifier.contains("1.3.3") and Version(pinned["hydra-core"]) >= Version("1.3.4")


def test_the_lock_has_every_pin_and_its_hashes() -> None:
    """``make lock`` writes it; what is built for a machine is not in it, and its first lines say so."""
    text, pinned = (ROOT / "requirements.lock").read_text(), pins("constraints.txt")
    locked = pins("requirements.lock")
    ours = {name: version for name, version in pinned.items() if name not in BUILT_FOR_MACHINES}
    assert {name: locked.get(name) for name in ours} == ours
    assert not [name for name in locked if name in BUILT_FOR_MACHINES or name.startswith(("nvidia", "cuda", "triton"))]
    comments = " ".join(re.findall(r"^# (.*)$", text, re.MULTILINE))
    assert all(word in comments for word in ("torch", "torchvision", "CUDA", "make lock"))
    for entry in re.split(r"^(?=[a-z])", text, flags=re.MULTILINE)[1:]:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry), entry.splitlines()[0]


def test_deepinv_is_tested() -> None:
    """Its tests cannot be skipped where ``make test`` installs it."""
    assert "deepinv" in " ".join(PROJECT["optional-dependencies"]["dev"])
    assert "skip(" not in (ROOT / "tests" / "encoder" / "test_physics.py").read_text()


def imported(extra: str) -> list[str]:
    """Return the modules that the packages of an extra are imported as."""
    names = [Requirement(line).name.replace("-", "_") for line in PROJECT["optional-dependencies"][extra]]
    return [f"hydra_plugins.{name}" if name.startswith("hydra_") else name for name in names]


@pytest.mark.slow
@pytest.mark.parametrize("extra", [extra for extra in PROJECT["optional-dependencies"] if extra != "dev"])
def test_every_extra_can_be_installed(extra: str, tmp_path: Path) -> None:
    """In a fresh environment, with the pinned versions; it downloads torch, as pip is configured here."""
    constraints = ROOT / ("constraints-ray.txt" if extra == "ray" else "constraints.txt")
    python = str(tmp_path / "bin" / "python")
    for line in (
        [sys.executable, "-m", "venv", str(tmp_path)],
        [python, "-m", "pip", "install", "--quiet", "--constraint", str(constraints), f"{ROOT}[{extra}]"],
        [python, "-m", "pip", "check"],
        [python, "-c", f"import sci_lightning, {', '.join(imported(extra))}"],
    ):
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)
        if "operator torchvision::" in done.stderr:
            pytest.skip("PyPI's torchvision is compiled for torch with CUDA, and torch is another one here")
        assert done.returncode == 0, done.stdout + done.stderr
