"""``--help`` of every command, and the commands themselves by name."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf

from sci_lightning.__main__ import COMPLETION, PROGRAMS, main
from sci_lightning.cli.help import first_comment, help_text, read_defaults, read_settings
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.diagnosis.search_settings import SearchSettings
from tests.conftest import ROOT, members

Configuration = Callable[..., DictConfig]
Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize("name", sorted(path.stem for path in CONF.glob("*.yaml")))
def test_every_setting_and_choice_is_there(name: str) -> None:
    text, config = help_text(CONF, name), OmegaConf.load(CONF / f"{name}.yaml")
    for key, value in config.items_ex(resolve=False):
        assert key in ("defaults", "hydra") or f"  {key}=" in text or (OmegaConf.is_dict(value) and f"  {key}." in text)
    for default in read_defaults((CONF / f"{name}.yaml").read_text()):
        group = default.key.partition("@")[0]
        if (CONF / group).is_dir() and not group.startswith("scale/"):
            for member in members(group):
                assert f" {member} " in text or f" {member}\n" in text, (group, member)


@pytest.mark.parametrize("path", sorted(CONF.rglob("*.yaml")), ids=lambda path: str(path.relative_to(CONF)))
def test_every_file_says_what_it_is(path: Path) -> None:
    assert first_comment(path.read_text()), "no comment at its top"


@pytest.mark.parametrize("path", sorted(CONF.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_setting_of_a_command_says_what_it_is(path: Path) -> None:
    settings = read_settings(path.read_text())
    assert {setting.key for setting in settings if not setting.about and "." not in setting.key} <= {"debug", "out"}


def test_what_is_read_of_a_file() -> None:
    settings = read_settings("# above\na: 1   # beside\n\nb:     # of b\n  c: [1, 2]\nhydra:\n  d: 1\n")
    assert [(setting.key, setting.value, setting.about) for setting in settings] == [
        ("a", "1", "above beside"),
        ("b.c", "[1, 2]", "of b"),
    ]


def test_settings_of_a_dataclass_have_their_defaults_and_what_they_mean(configuration: Configuration) -> None:
    text = help_text(CONF, "diagnose")
    assert configuration("diagnose", "search.max_effects=2").search == asdict(SearchSettings(max_effects=2))
    for field in fields(SearchSettings):
        assert re.search(rf"^  search\.{field.name}=\S+  +\w", text, re.MULTILINE)


def test_help_shows_the_choice_that_is_given() -> None:
    text = help_text(CONF, "train", ["decoder=stformer", "encoder=rsw_sr"])
    assert "* stformer" in text and "* rsw_sr" in text and "decoder.units=4" in text
    assert "* random_structural" in text and "encoder.mask.bits=4" in text


def test_help_in_a_process_of_its_own(command: Command) -> None:
    done = command("train", "--help")
    assert done.returncode == 0 and "T, time slots per snapshot" in done.stdout and done.stderr == ""
    assert "Hydra" in command("train", "--hydra-help").stdout
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    piped = f"{sys.executable} -m sci_lightning.train --help | head -1"
    cut = subprocess.run(piped, shell=True, env=environment, capture_output=True, text=True)
    assert cut.stderr == "" and cut.stdout.count("\n") == 1


SHOWN = """
import contextlib, io, json, os, runpy, sys
out = []
for name, *words in json.loads(sys.argv[1]):
    sys.argv, os.environ["COMP_LINE"], said = ["", *words], f"{name} ", io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        runpy.run_module(f"sci_lightning.{name}", run_name="__main__")
    out.append([bool(said.getvalue()), sorted({"torch", "lightning"} & sys.modules.keys())])
print(json.dumps(out))
"""


def test_help_and_completion_need_no_torch() -> None:
    """They answer at once, and importing torch and Lightning takes seconds."""
    calls = [[name, "--help"] for name in PROGRAMS]
    calls += [[name, "-sc", "query=bash"] for name in PROGRAMS if name not in ("captures", "virtual_camera.reveal")]
    words = [sys.executable, "-W", "ignore", "-c", SHOWN, json.dumps(calls)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    for call, (said, loaded) in zip(calls, json.loads(done.stdout), strict=True):
        assert said and not loaded, (call, loaded)


def called(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["sci-lightning", *words])
    main()


def test_names_of_commands(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    called(monkeypatch)
    called(monkeypatch, "--help")
    printed = capsys.readouterr().out
    called(monkeypatch, "commands")
    assert capsys.readouterr().out.split() == list(PROGRAMS) and all(name in printed for name in PROGRAMS)
    called(monkeypatch, "completion")
    assert capsys.readouterr().out.strip() == COMPLETION
    for word, answer in (("trian", "did you mean train?"), ("virtual_camrea", "virtual_camera"), ("xyz", "choose one")):
        with pytest.raises(SystemExit) as caught:
            called(monkeypatch, word)
        assert caught.value.code == 2
        error = capsys.readouterr().err
        assert answer in error and error.count("\n") == 1


def test_commands_by_name(command: Command) -> None:
    done = command("", "train", "decoder=no_net")
    assert done.returncode == 2 and done.stderr.startswith("error: decoder=no_net: no such decoder")
    assert "FOLDER out=FILE" in command("", "captures", "pack", "--help").stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    program = tmp_path / "sci-lightning"
    program.write_text(f"#!{sys.executable}\nfrom sci_lightning.__main__ import main\nmain()\n")
    program.chmod(0o755)
    script = "sci-lightning completion fish | source\n" if shell == "fish" else 'eval "$(sci-lightning completion)"\n'
    for line in ("sci-lightning ev", "sci-lightning train decoder=e", "sci-lightning captures i"):
        words = line.split()
        if shell == "fish":
            script += f"echo (complete -C '{line}')\n"
            continue
        script += f'COMP_LINE="{line}" COMP_CWORD={len(words) - 1} COMP_WORDS=({line})\n'
        script += '_sci_lightning\necho "${COMPREPLY[@]}"\n'
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    environment |= {"HOME": str(tmp_path)}
    done = subprocess.run([shell, "-c", script], env=environment, capture_output=True, text=True, cwd=tmp_path)
    lines = done.stdout.splitlines()
    expected = ["evaluate", "decoder=e2e_cnn decoder=efficientsci decoder=elp_unfolding", "info"]
    if shell == "zsh":  # which itself compares what it is given with the letters that are there
        assert all(set(right.split()) <= set(line.split()) for right, line in zip(expected, lines, strict=True))
    else:
        assert lines == expected


@pytest.mark.parametrize("words", [["completion"], ["--help"], ["train", "--help"], ["train", "--cfg", "job"]])
def test_output_that_nobody_reads(words: list[str], tmp_path: Path) -> None:
    """``COMMAND | head -1`` ends without a word about the pipe."""
    reader, writer = os.pipe()
    os.close(reader)
    program = [sys.executable, "-m", "sci_lightning", *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(program, stdout=writer, stderr=subprocess.PIPE, env=environment, cwd=tmp_path, text=True)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_what_answers_at_once_does_not_load_torch() -> None:
    program = (
        "import sys\n"
        "from sci_lightning.cli.commands import train, evaluate, diagnose\n"
        "print([name for name in ('torch', 'lightning', 'scipy', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
