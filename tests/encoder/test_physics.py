"""The encoder as deepinv's physics."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
import sys
import types
from collections.abc import Iterator
from importlib.machinery import ModuleSpec

import pytest
import torch

from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import MaskShift
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import Ideal
from sci_lightning.errors import BadInput
from tests.conftest import ROOT


def encoder() -> Encoder:
    return Encoder(RandomBinary(5, (16, 18), seed=1), Ideal(), aperture=0.5, effects=[MaskShift(dx=0.4, dy=-0.3)])


def test_without_deepinv(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "deepinv.physics", None)
    with pytest.raises(BadInput, match=r"sci-lightning\[deepinv\]"):
        encoder().as_deepinv()


class Substitute:
    """Stands for torchvision: deepinv names a few of its classes while it is imported, and nothing here uses them."""

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        return ModuleSpec(name, self, is_package=True) if name.partition(".")[0] == "torchvision" else None

    def create_module(self, spec: ModuleSpec) -> types.ModuleType:
        module = types.ModuleType(spec.name)
        module.__getattr__ = self.named
        return module

    @staticmethod
    def named(name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})

    def exec_module(self, module: types.ModuleType) -> None:
        pass


@pytest.fixture(scope="module")
def deepinv() -> Iterator[None]:
    """Import deepinv, if need be without torchvision: PyPI has it for torch with CUDA only.

    Where deepinv is not installed the tests fail: ``make test`` installs it, and what is promised of it is tested.
    """
    substitute = Substitute()
    if importlib.util.find_spec("torchvision") is None:
        sys.meta_path.append(substitute)
    importlib.import_module("deepinv")
    yield
    if substitute in sys.meta_path:
        sys.meta_path.remove(substitute)
        for name in [name for name in sys.modules if name.partition(".")[0] in ("deepinv", "torchvision")]:
            del sys.modules[name]


def test_with_a_broken_deepinv(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "deepinv.physics":
                raise RuntimeError("operator torchvision::nms does not exist")

    for name in [name for name in sys.modules if name.partition(".")[0] == "deepinv"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "deepinv", types.ModuleType("deepinv"))
    sys.modules["deepinv"].__path__ = []
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(BadInput, match=r"deepinv .*torchvision::nms"):
        encoder().as_deepinv()


@pytest.mark.usefixtures("deepinv")
def test_is_the_encoder() -> None:
    camera, video = encoder(), torch.rand(2, 5, 16, 18)
    physics = camera.as_deepinv()
    measurement = camera(video)[:, None]
    torch.testing.assert_close(physics.A(video), measurement)
    assert physics.adjointness_test(video, num_samples=8) < 1e-5
    least = physics.A_dagger(measurement)
    torch.testing.assert_close(physics.A(least), measurement)


@pytest.mark.usefixtures("deepinv")
def test_solvers() -> None:
    """Conjugate gradients find the closed form; a plug-and-play loop of deepinv's beats it."""
    from deepinv.models import TVDenoiser
    from deepinv.optim import L2, PGD, PnP
    from deepinv.physics import LinearPhysics

    physics = encoder().as_deepinv()
    video = torch.nn.functional.interpolate(torch.rand(1, 5, 3, 3), (16, 18), mode="bilinear")
    measurement = physics.A(video)
    least = physics.A_dagger(measurement)
    result = LinearPhysics.A_dagger(physics, measurement, solver="CG", max_iter=50, tol=1e-6)
    torch.testing.assert_close(result, least, rtol=0, atol=1e-3)
    step = float(1 / physics.mask.square().sum(0).max())
    settings = {"stepsize": step, "sigma_denoiser": 0.05, "max_iter": 40}
    estimate = PGD(data_fidelity=L2(), prior=PnP(TVDenoiser(n_it_max=10)), **settings)(measurement, physics)
    assert (estimate - video).square().mean() < 0.5 * (least - video).square().mean()


@pytest.mark.usefixtures("deepinv")
def test_the_notebook(capsys: pytest.CaptureFixture[str]) -> None:
    """The site executes it only where torchvision can be imported; a wrong light scale would show as a few dB."""
    notebook, names = ROOT / "docs" / "tutorials" / "deepinv.ipynb", {"__name__": "notebook"}
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    solver, universal, by_their_metric = map(float, re.findall(r"([\d.]+) dB", capsys.readouterr().out))
    assert solver > 24 and universal > 31 and abs(by_their_metric - universal) < 0.5
