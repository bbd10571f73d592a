"""``python -m sci_lightning.captures``: make a captures file of a folder, or see what is in one."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from datetime import datetime
from pathlib import Path
from typing import NoReturn

from sci_lightning.cli.console import PlainConsole, styled, warn
from sci_lightning.cli.next_command import invocation, print_next
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import one_printable_line

CONSOLE = PlainConsole()


class _Parser(ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message}; {self.prog} --help shows how")


def captures(arguments: list[str]) -> None:
    """Run ``pack FOLDER out=FILE`` or ``info FILE [out=DIR or PNG]``.

    Raises:
        BadInput: anything wrong with the words, the folder or the file.
    """
    given = _parser().parse_args(arguments)
    out = [word.removeprefix("out=") for word in given.words if word.startswith("out=")]
    places = [word for word in given.words if not word.startswith("out=")]
    if len(places) != 1 or len(out) > 1 or "" in out:
        raise BadInput(f"{given.command}: expected {given.expected}, got {' '.join(given.words) or 'nothing'}")
    given.task(places[0], out[0] if out else None)


def pack(folder: str, out: str | None) -> None:
    """Pack ``folder`` into the captures file ``out`` and say what went in."""
    from sci_lightning.captures.pack import pack_captures
    from sci_lightning.captures.table import facts

    if out is None:
        raise BadInput("pack: where to? give out=captures.h5")
    for line in facts(pack_captures(folder, out, on_warning=warn)):
        CONSOLE.print(line)
    CONSOLE.print(styled(out))
    print_next(CONSOLE, invocation("diagnose", paths={"captures": out}))


def info(file: str, out: str | None) -> None:
    """Print a captures file's table and write its contact sheet; ``out`` is a folder or a .png file."""
    from sci_lightning.captures.contact_sheet import contact_sheet
    from sci_lightning.captures.read import read_captures
    from sci_lightning.captures.table import facts, summary_table

    found = read_captures(file)
    sheet = Path(out or f"outputs/captures/{datetime.now():%Y-%m-%d_%H-%M-%S}")
    if sheet.suffix.lower() != ".png":
        sheet /= "contact_sheet.png"
    CONSOLE.print(summary_table(found))
    for line in facts(found):
        CONSOLE.print(line)
    left_out = contact_sheet(sheet, found)
    CONSOLE.say(styled(sheet), f" ({left_out} captures left out)" if left_out else "")
    print_next(CONSOLE, invocation("diagnose", paths={"captures": file}))


def main() -> None:
    """The command line: one line on stderr and status 2 on bad input; the traceback with ``HYDRA_FULL_ERROR=1``."""
    arguments = [word for word in sys.argv[1:] if word != "debug=true"]
    try:
        captures(arguments)
    except KeyboardInterrupt:
        sys.exit("interrupted")
    except Exception as error:
        if os.environ.get("HYDRA_FULL_ERROR") == "1" or "debug=true" in sys.argv:
            raise
        from sci_lightning.cli.failure_line import exit_status, one_line

        print(f"error: {one_printable_line(one_line(error))}", file=sys.stderr)
        sys.exit(exit_status(error))


def _parser() -> ArgumentParser:
    from sci_lightning.captures import recipe

    parser = _Parser("python -m sci_lightning.captures", description="Calibration captures of one camera.")
    commands = parser.add_subparsers(metavar="{pack,info}", required=True)
    words: tuple[tuple[str, object, str, str, str], ...] = (
        ("pack", pack, "FOLDER out=FILE", "one file of a folder of TIFF, PNG, MAT and NPY files", recipe.__doc__ or ""),
        ("info", info, "FILE [out=DIR or PNG]", "check a file, print what it holds, write its contact sheet", ""),
    )
    for name, task, expected, about, more in words:
        command = commands.add_parser(
            name,
            usage=f"python -m sci_lightning.captures {name} {expected}",
            help=f"{expected}: {about}",
            description=about,
            epilog=more,
            formatter_class=RawDescriptionHelpFormatter,
        )
        command.add_argument("words", nargs="*", metavar=expected)
        command.set_defaults(**Namespace(command=name, task=task, expected=expected).__dict__)
    return parser


if __name__ == "__main__":
    main()
