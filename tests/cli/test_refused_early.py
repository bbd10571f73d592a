"""What is wrong with a value or a path is said before torch is loaded, by every command and by the library."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sci_lightning.configuration.source_signature import check_parts
from sci_lightning.errors import BadInput
from tests.conftest import ROOT

REFUSED = {
    "train encoder.mask.bits=9": "from 1 to 8",
    "train data=folder data.root=nowhere": "no such",
    "train ckpt_path=RUN/checkpoints/lst.ckpt": "no such",
    "train trainer.max_epochs=abc": "whole number",
    "train +trainer.nonsense=3": "no such setting",
    "train system.lr=-1": "above 0",
    "train callbacks.last.every_minutes=-1": "at least 0",
    "evaluate ckpt_path=x.ckpt": "no such",
    "evaluate decoder=gap_tv data=six_scenes data.root=nowhere": "no such",
    "reconstruct decoder=gap_tv measurement=no.tiff": "no such",
    "diagnose captures=no.h5": "no such",
    "diagnose measurement=no.tif mask=no.npy": "no such",
    "tables runs=nowhere": "no such",
    "benchmark decoder=res2former decoder.dim=0": "from 1",
    "convert checkpoint=no.pth decoder=res2former": "no such",
    "captures info captures=no.h5": "no such",
    "export ckpt_path=no.ckpt": "no such",
    "export_mask ckpt_path=no.ckpt": "no such",
}
SCRIPT = """
import contextlib, io, json, runpy, sys
out = []
for line in json.loads(sys.argv[1]):
    name, *words = line.split()
    sys.argv = [name, *words]
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.suppress(SystemExit):
        runpy.run_module(f"sci_lightning.{name}", run_name="__main__", alter_sys=True)
    out.append([said.getvalue(), [heavy for heavy in ("torch", "lightning") if heavy in sys.modules]])
print(json.dumps(out))
"""


def test_without_torch(tmp_path: Path) -> None:
    words = [sys.executable, "-W", "ignore", "-c", SCRIPT, json.dumps(list(REFUSED))]
    done = subprocess.run(
        words, capture_output=True, text=True, check=True, cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}
    )
    for (line, reason), (said, loaded) in zip(REFUSED.items(), json.loads(done.stdout), strict=True):
        assert said.startswith("error: ") and reason in said and not loaded, (line, said, loaded)
    assert not list(tmp_path.iterdir())


def test_the_library_says_what_the_command_says() -> None:
    from sci_lightning.cli.notebook import train

    with pytest.raises(BadInput, match="no such decoder; did you mean e2e_cnn"):
        train(["decoder=e2ecnn"])
    with pytest.raises(BadInput, match=r"encoder\.mask\.bits=9: .* 1 to 8"):
        train(["encoder.mask.bits=9"])


def test_what_the_source_does_not_say_is_left_to_the_building() -> None:
    check_parts({"_target_": "my_module.Mine", "anything": -1, "inner": {"_target_": "also.Mine"}}, "decoder")
    check_parts({"_target_": "sci_lightning.data.SixScenes", "root": None, "size": "???"}, "benchmark")
    with pytest.raises(BadInput, match=r"decoder\.inner\.dim=0"):
        check_parts(
            {"_target_": "my_module.Mine", "inner": {"_target_": "sci_lightning.decoder.Res2former", "dim": 0}},
            "decoder",
        )
