"""Wrong words on a command line: one line that says what would be right, before anything is written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from sci_lightning.cli.command_line import check_words
from sci_lightning.cli.composition import compose
from sci_lightning.configuration.annotation import in_words
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import Mask
from sci_lightning.errors import BadInput

Refused = Callable[..., str]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["ckpt_path=a", "--bits", "3"], "--bits: no such option; .* without dashes, bits=3; --help"),
        (["--batch-size=4"], "without dashes, batch_size=4;"),
        (["-x"], "-x: no such option; .* x=\\.\\.;"),
        (["-c"], "--cfg/-c: expected one argument; sci_lightning.train --help"),
        (["--cfg", "nothing"], "invalid choice: 'nothing'.*--help"),
        (["encoder", "lsw_sr"], "encoder: expected key=value"),
        (["seed=1", "-c", "job", "size=[8,8]"], r"size=\[8,8\]: write options, .*, before all settings"),
    ],
)
def test_words_that_are_no_settings(words: list[str], line: str) -> None:
    with pytest.raises(BadInput, match=line):
        check_words("train", words)


def test_words_that_are_settings() -> None:
    for words in (["-m", "seed=1,2"], ["+a=1", "~b", "c="], ["--cfg", "job", "-p", "data", "seed=1"], ["--info"], []):
        check_words("train", words)


def test_one_line_and_nothing_written(refused: Refused, tmp_path: Path) -> None:
    assert "bits=3" in refused("export_mask", "ckpt_path=a.ckpt", "--bits", "3")
    assert "e2e_cnn" in refused("train", "seed=1,2", "-m", "decoder=nonsense", "out=sweep")
    assert not (tmp_path / "outputs").exists()


def test_a_search_path_that_is_no_folder(refused: Refused, tmp_path: Path) -> None:
    """Hydra only warns, in its own words, and goes on without it."""
    for place in ("file://nowhere", "pkg://nowhere.conf", "nowhere"):
        line = refused("benchmark", "decoder=linear", f"hydra.searchpath=[{place}]")
        assert re.search(r"hydra\.searchpath: nowhere\S* is no folder .*file://FOLDER", line)
    with pytest.raises(BadInput, match=r"hydra\.searchpath: nowhere"):
        compose("train", ["decoder=mine", "hydra.searchpath=[file://nowhere]"])


def test_a_plugin_that_is_not_installed(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sci_lightning.cli.command_line.find_spec", lambda name: None)
    for word, extra in {"hydra/launcher=slurm": "launchers", "hydra/launcher=ray": "ray"}.items():
        assert f"pip install 'sci-lightning[{extra}]'" in refused("train", "-m", word, "seed=0,1")


@pytest.mark.parametrize(
    ("word", "right"),
    [
        ("candidates={'a':5}", "without quotes around keys"),
        ("candidates={a:5}", r"\+candidates.mine=my_module.Mine; .* mask_blur, mask_contrast"),
        ("+candidates.a=5", r"\+candidates.mine=my_module.Mine"),
        ("candidates=5", r"\+candidates.mine=my_module.Mine"),
    ],
)
def test_candidates(refused: Refused, tmp_path: Path, word: str, right: str) -> None:
    (tmp_path / "a.h5").touch()
    line = refused("diagnose", f"captures={tmp_path}/a.h5", word)
    assert re.search(right, line) and "hydra.cc" not in line


def test_articles() -> None:
    assert (in_words(Encoder), in_words(Mask)) == ("an Encoder", "a Mask")
    assert in_words(list[Encoder]) == "a list of Encoders"


def test_file_in_the_place_of_a_folder(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "taken").write_text("kept")
    (tmp_path / "a.h5").touch()
    line = refused("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path / 'taken'}")
    assert "taken: a file stands where a folder is needed" in line
    assert (tmp_path / "taken").read_text() == "kept"
