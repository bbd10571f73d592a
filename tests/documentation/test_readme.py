"""Every command of README.md runs, at a small size and with small files in the place of its capitals."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.documentation.pages import commands_of


@pytest.mark.parametrize("command", commands_of(lambda page: page == "README.md"))
def test_command(command: str, run_command: Callable[[str], None]) -> None:
    run_command(command)
