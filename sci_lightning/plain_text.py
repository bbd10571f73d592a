"""Texts out of files and paths, made harmless for the place where they are shown: they are displayed, never obeyed."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence

LATEX_SIGNS = {
    "\\": r"\textbackslash{}",
    "±": r"$\pm$",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "[": "{[}",  # a row that begins with a bracket would be taken for the argument of the line break above it
    "]": "{]}",
}
HTML_SIGNS = {"&": "&amp;", "<": "&lt;", ">": "&gt;"}
LAST_LATIN = "\u024f"
"""The last character that LaTeX's standard fonts can be expected to know; of the others a question mark is shown."""


def printable(text: str) -> str:
    """Return the text with everything that a terminal would obey written out, such as ``\\x1b``; line breaks stay."""
    return "".join(sign if sign.isprintable() or sign == "\n" else ascii(sign)[1:-1] for sign in text)


def one_printable_line(text: str) -> str:
    """Return the text on one line, with everything that a terminal would obey written out."""
    return printable(" ".join(text.split()))


def excerpt(text: object, longest: int = 200) -> str:
    """Return any value as one printable line of at most ``longest`` signs, for a message that names it."""
    line = one_printable_line(str(text))
    return line if len(line) <= longest else f"{line[: longest - 2]}.."


def with_article(noun: str) -> str:
    """Return a noun after ``a`` or ``an``, whichever its first letter asks for."""
    return f"{'an' if noun[:1].lower() in set('aeiou') else 'a'} {noun}"


def file_name(text: str, longest: int = 60) -> str:
    """Return a name for a file in a folder of ours: letters, digits and ``_ - +``, dots only inside, never empty."""
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", text)[:longest].strip(".") or "unnamed"


def in_markdown(text: str) -> str:
    """Return Markdown that shows the text on one line: no emphasis, code, links, HTML or cells of a table in it."""
    text = re.sub(r"[\\`*\[\]|~#!$]|(?<!\w)_|_(?!\w)", lambda sign: f"\\{sign[0]}", one_printable_line(text))
    return re.sub("[&<>]", lambda sign: HTML_SIGNS[sign[0]], text)


def markdown_table(heading: Sequence[str], rows: Iterable[Sequence[str]], right: Container[int] = ()) -> str:
    """Return a table in Markdown, its last line without an end.

    Args:
        heading, rows: texts that are Markdown already, see :func:`in_markdown`.
        right: places of the columns that are aligned to the right.
    """
    rule = ["---:" if place in right else "---" for place in range(len(heading))]
    return "\n".join(f"| {' | '.join(row)} |" for row in (heading, rule, *rows))


def in_latex(text: str) -> str:
    """Return LaTeX that shows the text on one line; needs no package."""
    text = "".join(sign if sign <= LAST_LATIN else "?" for sign in one_printable_line(text))
    return re.sub(r"[\\±~^<>|\[\]&%$#_{}]", lambda sign: LATEX_SIGNS.get(sign[0], f"\\{sign[0]}"), text)


def in_figure(text: str, longest: int = 200) -> str:
    """Return a text for matplotlib whose dollar signs are shown and start no formula, cut after ``longest`` signs."""
    text = text if len(text) <= longest else f"{text[: longest - 2]}.."
    return printable(text).replace("$", r"\$")
