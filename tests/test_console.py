"""Paths, names and lines out of files on the terminal, in Markdown, LaTeX, figures and file names."""

from __future__ import annotations

import ast
import io
from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from rich.table import Table

from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.console import PlainConsole, styled, warn
from sci_lightning.plain_text import file_name, in_figure, in_latex, in_markdown, one_printable_line

HOSTILE = "a[/] [bold]b[/bold] [link=file:///etc]c[/link] :smile: \x1b[31m\x1b]8;;x\x07 \u202e\udcff"


def shown(draw: Callable[[PlainConsole], None], terminal: bool = True) -> str:
    text = io.StringIO()
    draw(PlainConsole(file=text, force_terminal=terminal, width=500, color_system=None))
    return text.getvalue()


def test_strings_are_shown_and_not_obeyed() -> None:
    def draw(console: PlainConsole) -> None:
        table = Table(HOSTILE, title=HOSTILE, caption=HOSTILE)
        table.add_row(HOSTILE)
        console.print(table)
        console.print(HOSTILE, style="dim")
        console.say(styled(HOSTILE), ": metrics.json")

    text = shown(draw)
    assert text.count("a[/] [bold]b[/bold] [link=file:///etc]c[/link] :smile: ") == 6
    assert not any(sign in text for sign in "\x1b\x07\u202e\udcff")
    assert text.count(r"\x1b[31m\x1b]8;;x\x07 \u202e\udcff") == 6


def test_lines_are_not_folded_and_tables_are_fitted() -> None:
    text = io.StringIO()
    console = PlainConsole(file=text, width=40)
    console.print("word " * 20)
    assert text.getvalue().count("\n") == 1
    console.print(Table("word " * 20))
    assert max(map(len, text.getvalue().splitlines()[1:])) <= 40


def test_every_line_goes_through_this_console() -> None:
    """No other module makes a console of its own, or writes markup into its texts."""
    for path in PACKAGE.rglob("*.py"):
        source = path.read_text()
        imports = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
        taken = {(node.module, name.name) for node in imports for name in node.names}
        assert path.name == "console.py" or ("rich.console", "Console") not in taken, path
        assert not {("rich.markup", "escape"), ("rich", "print")} & taken and "[/]" not in source.replace(
            "(``[/]``", ""
        ), path


def test_error_lines_carry_no_control_characters(refused: Callable[..., str], tmp_path: Path) -> None:
    line = refused("evaluate", "ckpt_path='\x1b[31m\x07gone[/].ckpt'")
    assert "\x1b" not in line and "\x07" not in line and r"\x1b[31m\x07gone[/].ckpt" in line


def test_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    warn("one\ntwo \x1b[2J")
    assert capsys.readouterr().err == "warning: one two \\x1b[2J\n"


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("x/../../y", "x_.._.._y"),
        ("..", "unnamed"),
        ("", "unnamed"),
        ("/etc/passwd", "_etc_passwd"),
        ("a\0b\n", "a_b_"),
        ("lsw_sr+mask_shift", "lsw_sr+mask_shift"),
        ("é" * 9, "_"),
        ("w" * 999, "w" * 60),
    ],
)
def test_file_names(text: str, name: str) -> None:
    assert file_name(text) == name


def test_markdown() -> None:
    text = "a|b `c` <script>alert(1)</script> ![x](http://y) **z** _w_ lsw_sr # & $x$ \n- 1"
    expected = (
        r"a\|b \`c\` &lt;script&gt;alert(1)&lt;/script&gt; \!\[x\](http://y) \*\*z\*\* \_w\_ lsw_sr \# &amp; \$x\$ - 1"
    )
    assert in_markdown(text) == expected
    assert in_markdown("\x1b[2J") == r"\\x1b\[2J"


def test_latex() -> None:
    assert in_latex(r"50 % & a_b ± \x") == r"50 \% \& a\_b $\pm$ \textbackslash{}x"
    assert in_latex("\\input{/etc/passwd} $x$ [2cm] ^^41 ~ #1 <|> \n\u4e2d") == (
        r"\textbackslash{}input\{/etc/passwd\} \$x\$ {[}2cm{]} \textasciicircum{}\textasciicircum{}41 "
        r"\textasciitilde{} \#1 \textless{}\textbar{}\textgreater{} ?"
    )
    assert one_printable_line("a\n\tb") == "a b"


@pytest.mark.parametrize("text", ["$\\frac{$", "$$", "a $x^2$ b", "\\$ $", "_hidden", "$\\undefined$"])
def test_figures(text: str) -> None:
    figure = Figure()
    drawn = figure.subplots().set_title(in_figure(text))
    figure.savefig(io.BytesIO())
    assert drawn._preprocess_math(drawn.get_text()) == (text, False)  # type: ignore[attr-defined]
