"""What a user may paste into a shell is quoted: zsh refuses ``key=[a,b]``, and every shell expands ``*`` and braces."""

from __future__ import annotations

import ast
import json
import re
import shlex
from pathlib import Path

import pytest

from sci_lightning.__main__ import EXAMPLES
from sci_lightning.cli.next_command import invocation
from sci_lightning.studies.tables.documentation import pages
from tests.conftest import ROOT
from tests.documentation.pages import blocks, name

TEXTS = [*pages(ROOT), ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"]
ARGUMENT = re.compile(r"""(?<!['"`\w.@/+}\]])(?P<word>\+{0,2}[a-z][\w.@/]*=[\[{])""")
"""The beginning of an override whose value is a list or a mapping, if nothing is quoted before it."""


def unquoted(line: str) -> list[str]:
    """Return the words of a command line that a shell would take for patterns, or for several words in braces."""
    bare = re.sub(r"\\.|'[^']*'|\"[^\"]*\"|\$\{[^}]*\}", "", line.partition(" #")[0])
    return [word for word in bare.split() if re.search(r"[\[\]{}*?]", word)]


def test_unquoted() -> None:
    line = "python -m sci_lightning.train 'size=[64,64]' \"a={b:1}\" encoder=a,b ${HOME}/x  # one [of] them"
    assert unquoted(line) == []
    assert unquoted("train size=[64,64] measurement=scene*.mat 'a'=[b] x={a,b}") == [
        *("size=[64,64]", "measurement=scene*.mat", "=[b]", "x={a,b}")
    ]


@pytest.mark.parametrize("page", TEXTS, ids=name)
def test_pages(page: Path) -> None:
    wrong = [word for block in blocks(page, "bash") for line in block.splitlines() for word in unquoted(line)]
    inline = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S))
    wrong += [code for code in inline if ARGUMENT.search(f" {code}") and "(" not in code]
    assert not wrong, f"{name(page)}: to be quoted: {wrong}"


def test_commands_and_makefile() -> None:
    lines = [*EXAMPLES.values(), *(ROOT / "Makefile").read_text().splitlines()]
    words = [word for line in lines if not line.startswith("#") for word in line.split()]
    assert not [word for word in words if ARGUMENT.match(word)]


def test_printed_command_lines() -> None:
    line = invocation("train", "size=[64,64]", "hydra.searchpath=[file://my_conf]", paths={"data.root": "a [b]"})
    assert unquoted(line) == []
    assert shlex.split(line)[3:] == ["data.root='a [b]'", "size=[64,64]", "hydra.searchpath=[file://my_conf]"]


def test_commands_of_measurements() -> None:
    """The documentation shows them below its tables."""
    for path in (ROOT / "docs" / "results").rglob("*.json"):
        provenance = json.loads(path.read_text()).get("provenance", {})
        assert not ARGUMENT.search(f" {provenance.get('command', '')}"), name(path)


def test_comments_of_settings() -> None:
    """``--help`` shows them."""
    for path in (ROOT / "conf").rglob("*.yaml"):
        comments = re.findall(r"#(.*)$", path.read_text(), re.MULTILINE)
        assert not [comment for comment in comments if ARGUMENT.search(comment)], name(path)


def texts(path: Path) -> list[str]:
    """Return the texts of a module, what is filled in as ``\\0``; those without a blank are words of a list."""
    tree = ast.parse(path.read_text())
    joined = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
    parts = {id(part) for node in joined for part in node.values}
    found = ["".join(str(part.value) if isinstance(part, ast.Constant) else "\0" for part in n.values) for n in joined]
    plain = [
        n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in parts
    ]
    return [text for text in (*found, *(str(node.value) for node in plain)) if " " in text]


def test_messages() -> None:
    """Advice in messages and docstrings; what a message repeats (``size=[8,8]: ..``) is not to be typed."""
    wrong = []
    for path in sorted((ROOT / "sci_lightning").rglob("*.py")):
        for text in texts(path):
            wrong += [text for _ in re.finditer(r"pip install [^'\"`]*\[", text)]
            for match in ARGUMENT.finditer(text):
                repeated = re.match(r"[^\]]*\](:| is )", text[match.end() :])
                wrong += [] if repeated else [f"{name(path)}: {text[match.start() :][:40]!r}"]
    assert not wrong
