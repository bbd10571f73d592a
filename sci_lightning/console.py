"""The terminal: whatever a path, a name or a file contributes to a line is shown as it is, and never obeyed.

What Lightning and torch say that tells a user nothing is silenced here as well.
"""

from __future__ import annotations

import logging
import sys
import warnings
from typing import Any

from rich.console import Console
from rich.text import Text

from sci_lightning.plain_text import one_printable_line, printable


class PlainConsole(Console):
    """A console of rich on which strings carry neither markup (``[/]``, ``[link=..]``) nor control characters.

    This holds for everything that is printed, cells and titles of tables included. Styles are given with
    :func:`styled`. Lines are not folded, so that paths and commands can be pasted; tables are fitted to the terminal.

    Args:
        settings: of :class:`rich.console.Console`.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"markup": False, "emoji": False, "highlight": False, **settings})

    def render_str(self, text: str, **settings: Any) -> Text:
        return super().render_str(printable(text), **settings)

    def print(self, *objects: Any, soft_wrap: bool | None = None, **settings: Any) -> None:
        if soft_wrap is None:
            soft_wrap = all(isinstance(part, (str, Text)) for part in objects)
        super().print(*objects, soft_wrap=soft_wrap, **settings)

    def say(self, *parts: str | Text) -> None:
        """Print one line made of parts, without spaces between them."""
        self.print(*parts, sep="")


def styled(text: object, style: str = "bold") -> Text:
    """Return a text that a :class:`PlainConsole` prints in a style of rich, such as ``bold`` or ``red``."""
    return Text(printable(str(text)), style)


def warn(line: str) -> None:
    """Print one line on standard error that begins with ``warning:``."""
    print(f"warning: {one_printable_line(line)}", file=sys.stderr)


def silence_libraries() -> None:
    """Drop what the libraries say that tells a user of a command nothing."""
    lightning = (
        f"lightning.pytorch.{name}"
        for name in ("utilities.rank_zero", "trainer.connectors.checkpoint_connector", "accelerators.cuda")
    )
    for name in (*lightning, "torch._subclasses.fake_tensor", "matplotlib"):
        logging.getLogger(name).setLevel(logging.WARNING)
    for message in (
        r".*does not have many workers.*",
        r".*LeafSpec.*",
        r".*`srun` command is available.*",
        r".*module\(s\) in eval mode.*",
        r".*smaller than the logging interval.*",
        r".*Checkpoint directory .* exists and is not empty.*",
        r".*your dataloader is not resumable.*",  # a training's position does
    ):
        warnings.filterwarnings("ignore", message=message)
