"""Everything a user can get wrong ends with one line that says what would be right, and a status that is not 0."""

from __future__ import annotations

import pickle
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.io import savemat

from sci_lightning.decoder import E2ECNN
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import read_checkpoint
from tests.clips import clips
from tests.conftest import members
from tests.training.small_training import TINY

Refused = Callable[..., str]


def test_unknown_members_list_the_choices(refused: Refused) -> None:
    line = refused("train", "decoder=res3former")
    assert "decoder=res3former: no such decoder" in line and ", ".join(members("decoder")) in line
    line = refused("train", "encoder=lsw")
    assert "lsw_sr, rbw_osr, rbw_sr, rsw_sr" in line
    assert "mask=solid" in refused("train", "encoder/mask=solid")


def test_in_a_process_of_its_own(command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    done = command("train", "decoder=res3former")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    done = command("train", "encoder.mask.bits=9", "debug=true")
    assert done.returncode != 0 and "Traceback" in done.stderr


@pytest.mark.parametrize("bits", ["0", "9", "2.5"])
def test_bits(refused: Refused, bits: str) -> None:
    assert "1 to 8" in refused("train", f"encoder.mask.bits={bits}")
    assert "1 to 8" in refused("train", "encoder=rsw_sr", f"encoder.mask.bits={bits}")


def test_one_frame(refused: Refused) -> None:
    assert "expected a whole number from 2" in refused("train", "frames=1")


def test_unknown_key(refused: Refused) -> None:
    assert "encoder.mask.bit" in refused("train", "encoder.mask.bit=3")
    assert "encoder.mask.bits" in refused("train", "encoder=rbw_sr", "encoder.mask.bits=3")


@pytest.mark.parametrize(
    ("override", "answer"),
    [
        ("encoder.mask.bit=3", "did you mean encoder.mask.bits?"),
        ("encodr=lsw_sr", "did you mean encoder?"),
        ("mask.bits=3", "did you mean encoder.mask.bits?"),
        ("lr=0.1", "did you mean system.lr?"),
        ("data.root=clips", "data has frames, size, "),
        ("decoder.dim.wide=3", "--help lists all"),
        ("encoder.effects.prnu.std=0.1", "effect=prnu puts that effect into the encoder"),
        ("trainer.limit_test_batches=1", "is added with +trainer.limit_test_batches=.."),
    ],
)
def test_a_setting_that_does_not_exist_is_told_from_those_that_do(refused: Refused, override: str, answer: str) -> None:
    line = refused("train", override)
    assert f"{override.partition('=')[0]}: no such setting" in line and answer in line


def test_a_name_that_is_nearly_right(refused: Refused) -> None:
    assert "no such decoder; did you mean res2former?" in refused("train", "decoder=res3former")
    assert "did you mean" not in refused("train", "decoder=transformer")


def test_a_setting_of_a_choice_that_has_no_default(refused: Refused) -> None:
    assert "error: give data.root=.." in refused("train", "data=folder")
    line = refused("evaluate", "decoder=gap_tv", "data=six_scenes")
    assert "error: give data.root=.." in line


def test_a_size_that_is_one_number(refused: Refused, command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    wanted = "size=64: expected [height,width]; of a square 'size=[64,64]'"
    for name, *more in (("train",), ("train", "crop=[64,64]"), ("evaluate", "decoder=gap_tv")):
        assert wanted in refused(name, "size=64", *more)
    camera = command("virtual_camera", "size=64")  # a package: not to be called in this process
    assert camera.returncode == 2 and wanted in camera.stderr
    assert "crop=[32,32]" in refused("train", "size=[64,64]", "crop=32")


WRONG = """
decoder.channels=abc decoder.channels=0 decoder.channels=null decoder.blocks=-1 decoder=null data=null
batch_size=1.5 batch_size=0 workers=-1 seed=1e30 seed=-1 crop=null frames=8.5 size=[32]
system.lr=-1 system.lr=fast system.mask_lr=-1 system.stage_weights=[] system.seed=null
trainer.precision=bf17 trainer.max_epochs=-2 trainer.devices=abc trainer.accelerator=tpu5 trainer=null
trainer.gradient_clip_val=-1 trainer.accumulate_grad_batches=0 trainer.max_time=soon trainer.max_time.minutes=2
data.clips_per_epoch=0 data.scenes_count=true data.size=null
encoder.aperture=-1 encoder.aperture=wide encoder.told=maybe
encoder.sensor.bit_depth=17 encoder.mask.sharpness=nan encoder.mask.tile=[0,8]
callbacks.last=5 callbacks.last.every_n_steps=-5 logger.tensorboard.save_dir=null metrics.psnr=5
"""


@pytest.mark.parametrize("override", WRONG.split())
def test_wrong_values_name_their_key(refused: Refused, override: str) -> None:
    line = refused("train", *(entry for entry in TINY if entry.split("=")[0] != override.split("=")[0]), override)
    assert override.split("=")[0].rpartition(".")[2] in line or "loss" in line
    assert "unforeseen" not in line


def test_loss(refused: Refused) -> None:
    assert "mse, rmse" in refused("train", *TINY, "system.loss=l1")


def test_metrics(refused: Refused) -> None:
    assert "luma-display, sRGB-display, luminance" in refused("train", *TINY, "metrics.qscore.encoding=sRGB")
    assert "must be a positive number" in refused("train", *TINY, "metrics.qscore.pixels_per_degree=-1")
    assert "psnr is missing" in refused("train", *TINY, "metric=[qscore]")
    assert "psnr is missing" in refused("train", *TINY, "metric=[]")
    line = refused("train", *TINY, "+metrics.mine._target_=torch.nn.Identity")
    assert "metrics.mine" in line and "no torchmetrics Metric" in line
    line = refused("train", *TINY, "size=[16,40]")
    assert "size=[16, 40]" in line and "17 x 17" in line and "metrics.qscore=null" in line
    assert "at least 1" in refused("train", *TINY, "system.val_every_n_frames.qscore=0")


def test_masks_that_do_not_fit(refused: Refused, tmp_path: Path) -> None:
    measured = [*TINY, "encoder=rbw_sr", "encoder/mask=measured", "encoder.mask.file=mask.npy"]
    np.save(tmp_path / "mask.npy", np.ones((8, 32, 40)))
    line = refused("train", *measured)
    assert "8 x 32 x 40" in line and "8 x 32 x 32" in line and "size=[32,40]" in line
    np.save(tmp_path / "mask.npy", np.full((8, 32, 32), 255))
    assert "[0, 1]" in refused("train", *measured)
    assert "encoder.mask.file" in refused("train", *measured[:-1])
    line = refused("train", *TINY, "crop=[48,48]")
    assert "crop" in line and "[32, 32]" in line


def test_clips(refused: Refused, tmp_path: Path) -> None:
    def folder(name: str) -> list[str]:
        return [*TINY, "data=folder", f"data.root={name}", "data.store=store"]

    assert "nowhere" in refused("train", *folder("nowhere"))
    (tmp_path / "empty").mkdir()
    assert "empty" in refused("train", *folder("empty"))

    broken = clips(tmp_path / "unfinite", "folder")
    np.savez(broken / "clip1.npz", frames=np.full((10, 64, 64), np.nan, np.float32))
    assert "clip1.npz" in refused("train", *folder("unfinite"))

    whole = (clips(tmp_path / "cut", "folder") / "clip2.npz").read_bytes()
    (tmp_path / "cut" / "clip2.npz").write_bytes(whole[: len(whole) // 2])
    assert "clip2.npz" in refused("train", *folder("cut"))


def test_benchmark(refused: Refused, tmp_path: Path) -> None:
    run = [*TINY, "data=synthetic", "benchmark.root=bench"]
    (tmp_path / "bench").mkdir()
    assert "kobe" in refused("train", *run)
    clips(tmp_path / "bench", "sixscenes")
    (tmp_path / "bench" / "drop_cacti.mat").unlink()
    line = refused("train", *run)
    assert "drop" in line and "scenes=[" in line
    savemat(tmp_path / "bench" / "drop_cacti.mat", {"frames": np.zeros((64, 64, 8)), "other": np.zeros((64, 64, 8))})
    line = refused("train", *run, "size=[64,64]")
    assert "drop_cacti.mat" in line and "'orig'" in line and "frames" in line


@pytest.mark.parametrize("out", ["/proc/run", "file/run"])
def test_output_folder_that_cannot_be_written(refused: Refused, tmp_path: Path, out: str) -> None:
    (tmp_path / "file").touch()
    assert "run" in refused("train", *TINY, f"out={out}")


@pytest.fixture
def checkpoint(refused: Refused, tmp_path: Path) -> Path:
    """A checkpoint of a tiny E2E-CNN, written by hand."""
    from hydra import compose, initialize_config_dir
    from hydra.utils import instantiate

    from sci_lightning.cli.composition import plain
    from sci_lightning.configuration.conf_folder import CONF
    from sci_lightning.training.system import System

    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", overrides=TINY)
    names = {"encoder": "lsw_sr", "decoder": "e2e_cnn"}
    system = System(*(instantiate(cfg[part], _convert_="all") for part in ("encoder", "decoder")))
    cfg.out = "unused"
    torch.save({"config": {**plain(cfg), "names": names}, "state_dict": system.state_dict()}, tmp_path / "e2e.ckpt")
    return tmp_path / "e2e.ckpt"


def test_checkpoint_of_another_decoder(refused: Refused, checkpoint: Path) -> None:
    tiny = [each for each in TINY if "decoder" not in each]
    line = refused("train", *tiny, "decoder=res2former", "decoder.dim=16", f"ckpt_path={checkpoint}")
    assert "decoder=e2e_cnn does not fit decoder=res2former" in line
    line = refused("train", *TINY, "decoder.channels=16", f"ckpt_path={checkpoint}")
    assert "does not fit" in line and "expected" in line
    line = refused("train", *TINY, "encoder=rbw_sr", f"ckpt_path={checkpoint}")
    assert "encoder=lsw_sr does not fit encoder=rbw_sr" in line


class Exploit:
    """Unpickling this would create a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self.path,)


def test_checkpoints_that_would_execute(refused: Refused, checkpoint: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "x.npy", np.zeros((32, 32), np.uint8))
    torch.save({"state_dict": Exploit(tmp_path / "executed")}, tmp_path / "a.ckpt")
    (tmp_path / "b.ckpt").write_bytes(pickle.dumps(Exploit(tmp_path / "executed")))
    for name in ("a.ckpt", "b.ckpt"):
        assert "refused" in refused("train", *TINY, f"ckpt_path={name}")
        assert "refused" in refused("evaluate", f"ckpt_path={name}", "data=synthetic")
        assert "refused" in refused("reconstruct", f"ckpt_path={name}", "measurement=x.npy")
    content = torch.load(checkpoint, weights_only=True)
    for target in (
        "os.system",
        "pathlib.Path",
        "sci_lightning.runs.checkpoint.Path.touch",
        "sci_lightning.cli.command.run",
    ):
        content["config"]["decoder"] = {"_target_": target, "_args_": [str(tmp_path / "executed")]}
        torch.save(content, tmp_path / "c.ckpt")
        assert "not a module of sci_lightning" in refused("evaluate", "ckpt_path=c.ckpt", "data=synthetic")
    assert not (tmp_path / "executed").exists()


def test_modules_of_a_trusted_package(checkpoint: Path) -> None:
    content = torch.load(checkpoint, weights_only=True)
    content["config"]["decoder"]["_target_"] = "tests.end_to_end.test_bad_input.Mine"
    torch.save(content, checkpoint)
    with pytest.raises(BadInput, match=r"trusted=\[tests\]"):
        read_checkpoint(checkpoint).decoder()
    assert type(read_checkpoint(checkpoint, ["tests"]).decoder()).__name__ == "Mine"


class Mine(E2ECNN):
    """A decoder that is not part of the package."""


def test_checkpoints_that_are_none(refused: Refused, checkpoint: Path, tmp_path: Path) -> None:
    assert "no such file" in refused("evaluate", "ckpt_path=absent.ckpt", "data=synthetic")
    (tmp_path / "cut.ckpt").write_bytes(checkpoint.read_bytes()[:5000])
    assert "damaged or truncated" in refused("evaluate", "ckpt_path=cut.ckpt", "data=synthetic")
    torch.save({"state_dict": {}}, tmp_path / "foreign.ckpt")
    assert "not a checkpoint of sci_lightning" in refused("evaluate", "ckpt_path=foreign.ckpt", "data=synthetic")
    assert "ckpt_path" in refused("evaluate", "data=synthetic")


def test_snapshots(refused: Refused, checkpoint: Path, tmp_path: Path) -> None:
    def line(name: str) -> str:
        return refused("reconstruct", f"ckpt_path={checkpoint}", f"measurement={name}")

    np.save(tmp_path / "nan.npy", np.full((32, 32), np.nan))
    savemat(tmp_path / "two.mat", {"a": np.zeros((32, 32)), "b": np.zeros((32, 32))})
    (tmp_path / "cut.png").write_bytes(b"\x89PNG\r\n\x1a\n0000")
    (tmp_path / "notes.txt").write_text("no picture")
    np.save(tmp_path / "dn.npy", np.full((32, 32), 200.5))
    assert "NaN" in line("nan.npy")
    assert "full_scale=" in line("dn.npy")
    assert "'meas'" in line("two.mat")
    assert "damaged" in line("cut.png")
    assert "use one of" in line("notes.txt")
    assert "no such file" in line("absent.tiff")


def test_loss_that_diverges_keeps_the_last_good_checkpoint(refused: Refused, tmp_path: Path) -> None:
    every_step = ["callbacks.last.every_minutes=null", "callbacks.last.every_n_steps=1"]
    lr = ["system.lr=1e18", "system.final_lr=1e18", "decoder.input_residual=true", "out=run"]
    line = refused("train", *TINY, *every_step, *lr, "data.clips_per_epoch=40", status=1)
    assert "batch" in line and "last good" in line
    state = read_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt").state
    assert all(torch.isfinite(value).all() for value in state.values())
