"""A stranger's checkpoint, resumed: nothing is removed or executed, and what cannot be taken up is one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint, Timer

from sci_lightning.data import Scene
from sci_lightning.data.loader import scene_loader
from sci_lightning.errors import BadInput
from tests.training.small_training import system_and_trainer, train

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a training that was killed after its fourth step leaves."""
    folder = tmp_path_factory.mktemp("run")
    train(folder, 4)
    return dict(torch.load(folder / "last.ckpt", weights_only=True))


def resume(path: Path, *callbacks: Any) -> Any:
    system, trainer, clips = system_and_trainer(path.parent / "resumed", callbacks)
    trainer.fit(system, clips, scene_loader([Scene("noise", torch.rand(1, 2, 4, 4))]), ckpt_path=str(path))
    return trainer


def paths_to(victim: Path, folder: Path) -> list[str]:
    link = folder / "link"
    link.symlink_to(victim.parent)
    return [str(victim), f"local://{victim}", f"{folder}/resumed/../victim/file", f"{link}/file", str(victim.parent)]


@pytest.mark.parametrize("form", range(5))
def test_nothing_is_removed(checkpoint: dict[str, Any], tmp_path: Path, form: int) -> None:
    victim = tmp_path / "victim" / "file"
    victim.parent.mkdir()
    victim.write_text("precious")
    hostile = paths_to(victim, tmp_path)[form]
    mine = ModelCheckpoint(dirpath=tmp_path / "resumed", filename="mine", monitor="val/psnr", mode="max")
    state = {
        "monitor": "val/psnr",
        "best_model_score": torch.tensor(-1.0),
        "best_model_path": hostile,
        "current_score": torch.tensor(-1.0),
        "dirpath": str(tmp_path / "resumed"),
        "best_k_models": {hostile: torch.tensor(-1.0)},
        "kth_best_model_path": hostile,
        "kth_value": torch.tensor(-1.0),
        "last_model_path": hostile,
    }
    keys = [mine.state_key, "ModelCheckpoint", "LastCheckpoint", "BestCheckpoint", *checkpoint["callbacks"]]
    path = tmp_path / "hostile.ckpt"
    torch.save({**checkpoint, "callbacks": dict.fromkeys(keys, state)}, path)
    resume(path, mine)
    assert victim.read_text() == "precious" and path.is_file()
    assert (tmp_path / "resumed" / "best.ckpt").is_file() and Path(mine.best_model_path).parent == tmp_path / "resumed"


def test_scores_and_times_are_taken_up(checkpoint: dict[str, Any], tmp_path: Path) -> None:
    states = {
        "BestCheckpoint": {"best": 99.0},
        "Timer": {"time_elapsed": {"train": 7.0}},
        EarlyStopping("val/psnr").state_key: {"wait_count": 1, "stopped_epoch": 0, "best_score": torch.tensor(0.0)},
    }
    path = tmp_path / "a.ckpt"
    torch.save({**checkpoint, "callbacks": states}, path)
    (tmp_path / "resumed").mkdir()
    (tmp_path / "resumed" / "best.ckpt").write_text("a better one")
    timer, stopping = Timer(duration={"hours": 1}), EarlyStopping("val/psnr", mode="max", patience=100)
    resume(path, timer, stopping)
    assert (tmp_path / "resumed" / "best.ckpt").read_text() == "a better one"
    assert timer.time_elapsed() >= 7.0


def test_what_is_unknown_is_left_alone(checkpoint: dict[str, Any], tmp_path: Path) -> None:
    more = {
        "loops": {"fit_loop": "x"},
        "hyper_parameters": {"_target_": "os.system"},
        "hparams_name": "kwargs",
        "hparams_type": "os.system",
        "datamodule": {"_target_": "os.system"},
        "pytorch-lightning_version": "0.0.1",
        "epoch": "x",
        "__init__": 1,
    }
    path = tmp_path / "a.ckpt"
    torch.save({**checkpoint, **more}, path)
    assert resume(path).global_step == 15


def changed(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Set an entry of nested dictionaries and lists; ``KeyError`` removes it."""

    def change(content: Any) -> None:
        *above, last = (int(key) if key.lstrip("-").isdigit() else key for key in path.split("/"))
        for key in above:
            content = content[key]
        if value is KeyError:
            del content[last]
        else:
            content[last] = value

    change.__name__ = f"{path}={value!r:.30}"
    return change


DAMAGED = [
    *(changed("position", value) for value in ("x", 4, {"steps": 4}, {"steps": 4.0, "batches_per_epoch": 5})),
    *(changed("position/steps", value) for value in (-1, True, 2**62, None, 16)),
    changed("position/validated", 1),
    *(changed("optimizer_states", value) for value in ([], "x", None, [None], [{}, {}], {"state": {}})),
    *(changed("optimizer_states/0/state", value) for value in ([], "x", {"x": {}}, {99: {}}, {-1: {}}, {0: None})),
    *(changed("optimizer_states/0/state/0/exp_avg", value) for value in (KeyError, "x", torch.zeros(3), None)),
    changed("optimizer_states/0/state/0/exp_avg", torch.zeros(2, 2, 1, 1, dtype=torch.complex64)),
    changed("optimizer_states/0/state/0/more", torch.zeros(())),
    *(changed("optimizer_states/0/param_groups", value) for value in ([], None, [{"lr": 1.0}], "x")),
    *(changed("optimizer_states/0/param_groups/0/lr", value) for value in ("x", -1.0, float("nan"), None, KeyError)),
    *(changed("callbacks", value) for value in ("x", [1])),
    *(changed("callbacks/BestCheckpoint", value) for value in ({"best": None}, {"x": 1}, {"best": torch.zeros(2)})),
    changed("callbacks/Timer", {"time_elapsed": {"train": None}}),
    *(changed("MixedPrecision", value) for value in ("x", {}, {"scale": "x"}, {"scale": 1.0})),
    *(changed("state_dict", value) for value in ("x", None, {})),
    changed("state_dict/decoder.net.bias", torch.zeros(3)),
    changed("state_dict/decoder.net.bias", KeyError),
    changed("state_dict/decoder.net.more", torch.zeros(3)),
    changed("state_dict/decoder.net.bias", torch.zeros(2).to_sparse()),
]


@pytest.mark.parametrize("change", DAMAGED, ids=lambda change: change.__name__)
def test_wrong_contents_are_one_line(
    checkpoint: dict[str, Any], tmp_path: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    path = tmp_path / "a.ckpt"
    torch.save(checkpoint, path)
    content = torch.load(path, weights_only=True)
    change(content)
    torch.save(content, path)
    with pytest.raises(BadInput, match=r"a\.ckpt: (damaged|15|16 steps were made)") as caught:
        resume(path, Timer(duration={"hours": 1}))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "resumed").exists()
