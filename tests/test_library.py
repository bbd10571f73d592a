"""What ``import sci_lightning as sci`` offers a notebook: loaded when it is used, with examples that run."""

from __future__ import annotations

import ast
import doctest
import inspect
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import torch

import sci_lightning as sci
from sci_lightning.__main__ import EXAMPLES
from sci_lightning.errors import BadInput
from tests.conftest import ROOT

NAMES = [name for name in sci.__all__ if name != "__version__"]
DOCUMENTED = [
    "HDRVDP2",
    "Pipeline",
    "SnapshotOperator",
    "VirtualCamera",
    "command",
    "design_mask",
    "evaluate",
    "load_decoder",
    "load_video",
    "plot",
    "reconstruct",
]
"""Names whose docstring has an example."""


def python(program: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_it_loads_neither_torch_nor_hydra() -> None:
    """Of the package itself only: every other name is loaded when it is first used."""
    program = (
        "import sys; before = set(sys.modules); import sci_lightning as sci; dir(sci)\n"
        "print(sorted(name for name in set(sys.modules) - before if name.split('.')[0] not in sys.stdlib_module_names))"
    )
    assert python(program) == "['sci_lightning']"


def test_commands_that_train_nothing_start_without_lightning() -> None:
    """Together with torch's compiler it takes longer to import than a small reconstruction."""
    modules = ["cli.encoder_and_decoder", "diagnosis.diagnosis", "cli.commands.diagnose", "virtual_camera"]
    modules.append("studies.figures.mosaic")
    program = f"import sys, {', '.join(f'sci_lightning.{module}' for module in modules)}\n"
    program += "print(*({'lightning', 'torch._dynamo', 'torchmetrics'} & set(sys.modules)))"
    assert python(program) == ""


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_documented(name: str) -> None:
    value = getattr(sci, name)
    assert name in dir(sci) and inspect.getdoc(value)
    assert not (isinstance(value, ModuleType) and ":" in sci.PUBLIC_NAMES[name])


def test_type_checkers_see_the_same_names() -> None:
    source = ast.parse((ROOT / "sci_lightning" / "__init__.py").read_text())
    block = next(node for node in source.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname or alias.name for node in imports for alias in node.names}
    assert seen == set(NAMES) == set(sci.PUBLIC_NAMES)
    assert (ROOT / "sci_lightning" / "py.typed").is_file()


@pytest.mark.parametrize("name", ["", *DOCUMENTED])
def test_examples(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    value = getattr(sci, name) if name else sci
    known = {"torch": torch, "sci": sci, name: value}
    finder = doctest.DocTestFinder(recurse=False)
    examples = [test for test in finder.find(value, name or "sci", module=False, globs=known) if test.examples]
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert examples and all(runner.run(test).failed == 0 for test in examples)


def test_training_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of ``sci.train`` runs; its folder is not overwritten, and its configuration can be given again."""
    import json

    monkeypatch.chdir(tmp_path)
    (example,) = doctest.DocTestFinder(recurse=False).find(sci.train, "train", module=False, globs={})
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example).failed == 0

    assert callable(sci.train) and not isinstance(sci.train, ModuleType)
    config = json.loads((tmp_path / "run" / "metrics.json").read_text())["config"]
    with pytest.raises(BadInput, match="holds an earlier run"):
        sci.train(config)
    again = sci.train({**config, "resume": True})
    assert again.finished_before and again.metrics.decoder == "e2e_cnn" and again.metrics.mean["psnr"] > 0
    with pytest.raises(BadInput, match="batch_size=0"):
        sci.train(["batch_size=0"])
    with pytest.raises(BadInput, match="holds an earlier run"):  # as the command says it
        sci.command("train", {"out": "run"})
    with pytest.raises(BadInput, match="of another configuration"):
        sci.command("train", {"out": "run", "resume": True, "dry_run": False})


@pytest.mark.usefixtures("short_pictures")
def test_what_a_command_does_one_call_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The modules of the commands have the same names as the functions, which stay functions."""
    import sci_lightning.studies.tables.grid  # noqa: F401

    monkeypatch.chdir(tmp_path)
    scenes = {"data": "synthetic", "data.scenes_count": 1, "frames": 4, "size": [32, 32], "metric": ["psnr"]}
    done = sci.evaluate({"decoder": "linear", **scenes, "out": "a folder, [named] 'oddly'"})
    assert done.folder == Path("a folder, [named] 'oddly'") and done.pictures[0].is_file()
    assert done.metrics.mean["psnr"] > max(20.0, done.metrics.baseline["psnr"])
    words = ["decoder=linear", "data=synthetic", "data.scenes_count=1", "frames=4", "size=[32,32]", "metric=[psnr]"]
    assert sci.evaluate([*words, "out=again"]).metrics.mean == done.metrics.mean

    made = sci.tables({"runs": [str(done.folder), "again"], "out": "tables", "mosaic": 0})
    assert len(made.runs) == 1 and "the same row" in made.left_out[0]  # a test that was repeated counts once
    assert "linear" in made.grids["runs"].as_markdown() and (made.folder / "table1.md").is_file()
    assert all(path.is_file() for path in made.figures.values())


def test_a_call_refuses_what_its_command_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run" / "checkpoints").mkdir(parents=True)
    (tmp_path / "run" / "checkpoints" / "last.ckpt").touch()
    for call, settings, line in (
        (sci.evaluate, {"decoder": "linear", "out": "run"}, "holds a training"),
        (sci.evaluate, {"out": "a"}, "ckpt_path="),
        (sci.evaluate, "decoder=linear", "list of overrides"),
        (sci.evaluate, {"decoder": "linear", "seed": -1}, "seed"),
        (sci.tables, {"out": "a"}, "runs=DIR"),
        (sci.tables, {"runs": "nowhere", "out": "a"}, "nowhere"),
        (sci.design_mask, {"frames": 1, "out": "a"}, "frames"),
        (sci.design_mask, {"tile": [64, 64], "size": [32, 32], "out": "a"}, "larger than the mask"),
    ):
        with pytest.raises(BadInput, match=line):
            call(settings)
    assert not (tmp_path / "run" / "metrics.json").exists()


def test_a_checkpoint_trains_further_in_a_users_own_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What ``train`` wrote, read by ``load_from_checkpoint`` with another learning rate, goes on learning."""
    import lightning as L
    from torch.utils.data import DataLoader

    from sci_lightning.training.system import System

    monkeypatch.chdir(tmp_path)
    words = ["scale=smoke", "decoder=e2e_cnn", "metric=[psnr]", "logger=none", "data.scenes_count=1", "out=run"]
    run = sci.train([*words, "callbacks.progress=null", "trainer.accelerator=cpu"])
    system = System.load_from_checkpoint(run.checkpoint, lr=1e-3)
    assert system.hparams["lr"] == 1e-3
    before = {name: value.clone() for name, value in system.named_parameters()}
    clips: DataLoader[torch.Tensor] = DataLoader(list(torch.rand(4, 8, 32, 32)), batch_size=2)  # type: ignore[arg-type]
    trainer = L.Trainer(max_steps=2, accelerator="cpu", logger=False, enable_checkpointing=False)
    trainer.fit(system, clips)
    moved = {name for name, value in system.named_parameters() if not torch.equal(value, before[name])}
    assert any(name.startswith("decoder.") for name in moved) and any(name.startswith("encoder.") for name in moved)


@pytest.mark.parametrize("name", [*EXAMPLES, "tables.rows"])
def test_every_command_is_one_call(name: str) -> None:
    with pytest.raises(BadInput, match="nonsense"):
        sci.command(name, {"nonsense": 1})


def test_commands_that_do_not_exist() -> None:
    for name in ("fly", "captures fly", "train fly", ""):
        with pytest.raises(BadInput, match="no such command"):
            sci.command(name)


def test_unknown_names() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Encodre'"):
        _ = sci.Encodre  # type: ignore[attr-defined]


def test_a_decoder_by_its_name_out_of_a_checkpoint_and_with_published_weights(tmp_path: Path) -> None:
    from sci_lightning.runs.checkpoint import write_weights

    torch.manual_seed(1)
    small = ["frames=4", "scale=smoke"]
    network = sci.load_decoder("e2e_cnn", small)
    torch.save(network.state_dict(), tmp_path / "published.pth")
    filled = sci.load_decoder(tmp_path / "published.pth", small, name="e2e_cnn")
    assert all(torch.equal(filled.state_dict()[key], value) for key, value in network.state_dict().items())
    for source, line in (("no_net", "no such decoder or checkpoint"), ("no.ckpt", "give a path")):
        with pytest.raises(BadInput, match=line):
            sci.load_decoder(source)
    with pytest.raises(BadInput, match=r"published\.pth: .* has no place in Res2former"):
        sci.load_decoder(tmp_path / "published.pth", name="res2former")
    from sci_lightning.cli.composition import compose, plain

    config = plain(compose("train", ["decoder=e2e_cnn", "size=[16,16]", *small]).cfg)
    names = {"encoder": "lsw_sr", "decoder": "e2e_cnn"}
    write_weights(
        tmp_path / "w.ckpt", {**config, "names": names}, {f"decoder.{k}": v for k, v in network.state_dict().items()}
    )
    again = sci.load_decoder(tmp_path / "w.ckpt")
    assert all(torch.equal(again.state_dict()[key], value) for key, value in network.state_dict().items())
