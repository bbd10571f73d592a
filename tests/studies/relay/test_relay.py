"""The relay: which training gets the next lease, what a lease leaves, what travels, and leases that are killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from omegaconf import DictConfig

from sci_lightning.cli.next_command import override
from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json
from sci_lightning.studies.relay.relay import Relay
from sci_lightning.studies.relay.relay_archive import pack, unpack
from sci_lightning.studies.relay.relay_queue import Lease, RelayQueue
from tests.conftest import ROOT

TINY = [
    *("scale=smoke", "encoder=lsw_sr", "decoder=e2e_cnn", "decoder.channels=4", "system.warmup=0.05"),
    *("system.cooldown=0.2", "trainer.max_epochs=10000", "data.clips_per_epoch=40", "+trainer.limit_val_batches=1"),
    *("callbacks.best=null", "callbacks.failed_training.stop=false", "metrics.qscore=null", "logger=none"),
    "data.scenes_count=2",
]


def lease(seconds: float = 30.0, finished: bool = True) -> Lease:
    return Lease(date="2026-11-28", machine="abacus", commit="0", seconds=seconds, steps=5, clips=10, finished=finished)


def queue(path: Path, *trainings: dict[str, Any]) -> Path:
    entries = [{"what": "a network", "command": "train", "recipe": TINY, **training} for training in trainings]
    path.write_text(json.dumps({"format": "sci-relay", "format_version": 1, "trainings": entries}))
    return path


def relay(path: Path, **settings: Any) -> Relay:
    return Relay(
        path, path.parent / "state", seconds=60, reserve=20, footage=path.parent, override=override, **settings
    )


def test_trainings_follow_in_their_order_until_each_has_what_is_wanted(tmp_path: Path) -> None:
    names = [{"name": name, "wanted": 50, "at_once": number} for name, number in zip("abcd", (2, 2, 2, 1), strict=True)]
    wanted = read_json(queue(tmp_path / "q.json", *names, {"name": "rows", "command": "tables.rows"}), RelayQueue)

    def following(*without: str) -> str:
        return " ".join(training.name for training in wanted.following(set(without)))

    assert following() == "a b" and following("a") == "b c"
    wanted = wanted.given("a", lease(30), 0).given("a", lease(20, finished=False), 1)
    assert following() == "b c" and following(*"bc") == "d" and following(*"bcd") == "rows"
    assert not wanted.given("rows", lease(1), 0).following(set("bcd"))
    again = wanted.given("a", lease(25), 1).training("a")  # a lease that goes on takes the place of its earlier state
    assert [one.seconds for one in again.leases] == [30, 25]


def test_what_is_no_queue(tmp_path: Path) -> None:
    for entries in (
        [{"name": "a", "recipe": []}],
        [{"name": "a"}, {"name": "a"}],
        [{"name": "../a"}],
        [{"name": "a", "command": "export"}],
        [],
    ):
        with pytest.raises(BadInput, match=r"q\.json: trainings"):
            read_json(queue(tmp_path / "q.json", *entries), RelayQueue)
    with pytest.raises(BadInput, match=r"seconds=10: .*reserve=20"):
        Relay(queue(tmp_path / "q.json", {"name": "a"}), tmp_path, 10, 20, tmp_path, override)


def test_an_archive_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was written on one machine is taken over on another; a part that is missing is noticed."""
    monkeypatch.setattr("sci_lightning.studies.relay.relay_archive.PART", 2**12)
    there, here = (queue(tmp_path / name, {"name": "a"}) for name in ("there.json", "here.json"))
    content = os.urandom(9000)
    (tmp_path / "weights").write_bytes(content)
    there.write_text(json.dumps(read_json(there, RelayQueue).given("a", lease(), 0).as_json()))
    pack({"queue.json": there, "state/a/weights.safetensors": tmp_path / "weights"}, tmp_path / "archive")
    assert [path.name for path in sorted((tmp_path / "archive").iterdir())] == [f"relay.zip.{n}" for n in range(3)]
    relay(here).take(tmp_path / "archive")
    assert (tmp_path / "state" / "a" / "weights.safetensors").read_bytes() == content
    assert read_json(here, RelayQueue) == read_json(there, RelayQueue)
    (tmp_path / "archive" / "relay.zip.1").unlink()
    with pytest.raises(BadInput, match="missing or damaged"):
        unpack(tmp_path / "archive")


def test_what_an_archive_may_not_hold(tmp_path: Path) -> None:
    path = queue(tmp_path / "q.json", {"name": "a"})
    for name in ("../evil.json", "/evil.json", "elsewhere/evil.json", "state/../../evil"):
        (tmp_path / "archive").mkdir(exist_ok=True)
        with zipfile.ZipFile(tmp_path / "archive" / "relay.zip.0", "w") as archive:
            archive.writestr("queue.json", path.read_text())
            archive.writestr(name, "evil")
        with pytest.raises(BadInput, match="evil"):
            relay(path).take(tmp_path / "archive")
        assert not list(tmp_path.parent.rglob("evil*"))
    (tmp_path / "kept.json").write_text("1")
    for name, said in (("page.md", "no lease"), ("kept.json", "something else"), ("no.json", "no JSON")):
        with zipfile.ZipFile(tmp_path / "archive" / "relay.zip.0", "w") as archive:
            archive.writestr("queue.json", path.read_text())
            archive.writestr("results/before.json", "{}")
            archive.writestr(f"results/{name}", "evil")
        with pytest.raises(BadInput, match=said):
            relay(path).take(tmp_path / "archive")
        assert not (tmp_path / "before.json").exists() and (tmp_path / "kept.json").read_text() == "1"
    row = tmp_path / "tables" / "relay" / "a" / "seed0.json"
    for content in ("1", "2"):  # which every lease writes anew
        (tmp_path / "row.json").write_text(content)
        pack({"queue.json": path, "results/tables/relay/a/seed0.json": tmp_path / "row.json"}, tmp_path / "archive")
        relay(path).take(tmp_path / "archive")
        assert row.read_text() == content
    entry = {"what": "a network", "command": "train", "recipe": [*TINY, "+callbacks.x={_target_:os.system}"]}
    other = queue(tmp_path / "other.json", {"name": "a", **entry})
    pack({"queue.json": other}, tmp_path / "archive")
    with pytest.raises(BadInput, match="recipes come from the repository alone"):
        relay(path).take(tmp_path / "archive")
    ahead = read_json(path, RelayQueue).given("a", lease(), 0)
    path.write_text(json.dumps(ahead.as_json()))
    pack({"queue.json": queue(tmp_path / "old.json", {"name": "a"})}, tmp_path / "archive")
    with pytest.raises(BadInput, match="a: has leases here"):
        relay(path).take(tmp_path / "archive")


WANTED = read_json(ROOT / "docs" / "results" / "relay.json", RelayQueue).trainings


@pytest.mark.parametrize("training", [one for one in WANTED if one.recipe], ids=lambda one: one.name)
def test_the_queue_of_this_repository(training: Any, configuration: Callable[..., DictConfig]) -> None:
    """Every recipe can be composed; what is trained are the published networks, whose rates fall at a lease's end."""
    command = {"tables.rows": "tables_rows"}.get(training.command, training.command)
    words = [word.replace("{footage}", "DATA") for word in training.recipe if word != "decoder=all"]
    cfg = configuration(command, *words)
    if training.command == "train":
        decoder = configuration("train", f"decoder={training.recipe[2].partition('=')[2]}").decoder
        assert cfg.decoder == decoder and cfg.system.cooldown and cfg.data.val_root == "DATA/val"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the signal at a parent's end is Linux's")
def test_three_leases_of_which_one_is_killed(tmp_path: Path) -> None:
    """Nothing is lost but seconds: the killed lease counts up to its last checkpoint, and the next goes on there."""
    path = queue(tmp_path / "q.json", {"name": "tiny", "wanted": 1000})
    words = ["queue=q.json", "seconds=60", "reserve=20", "footage=.", "archive=archive", "out=state"]
    line = [sys.executable, "-m", "sci_lightning.tables.relay", *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}

    def leases() -> list[Lease]:
        return read_json(path, RelayQueue).training("tiny").leases

    subprocess.run(line, cwd=tmp_path, env=environment, check=True, timeout=300)
    (first,) = leases()
    assert first.finished and first.clips == 2 * first.steps > 0 and set(first.mean) == {"psnr", "ssim"}
    kept = tmp_path / "tables" / "relay" / "tiny" / "seed0.json"
    assert json.loads(kept.read_text())["clips_seen"] == first.clips

    killed = subprocess.Popen(line, cwd=tmp_path, env=environment, start_new_session=True)
    until = time.monotonic() + 200
    while len(leases()) < 2 and time.monotonic() < until:
        time.sleep(0.2)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait(60)
    assert leases()[0] == first and not leases()[1].finished and leases()[1].steps > 0

    subprocess.run(line, cwd=tmp_path, env=environment, check=True, timeout=300)
    assert leases()[0] == first and leases()[1].steps > 0 and leases()[2].finished
    total = json.loads(kept.read_text())
    assert total["clips_seen"] == sum(one.clips for one in leases()) and "3 leases" in total["provenance"]["scale"]
    assert "state/tiny/weights.safetensors" in unpack(tmp_path / "archive")
