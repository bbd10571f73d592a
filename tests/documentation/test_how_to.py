"""Every command of the how-to pages runs: what one command of a page writes with ``out=``, a later one reads."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.documentation.pages import commands_of


@pytest.mark.parametrize("command", commands_of(lambda page: page.startswith("docs/how-to/")))
def test_command(command: str, run_command: Callable[[str], None]) -> None:
    run_command(command)
