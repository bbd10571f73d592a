"""The page needs nothing but itself, and says what was found."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.leftover import Unnamed
from sci_lightning.diagnosis.pictures import figures
from sci_lightning.diagnosis.report import describe
from sci_lightning.diagnosis.report_page import report_page
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, capture_session, write_captures

VOID = {"meta", "link", "br", "img", "input"}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A shift and a map: a page with every section."""
    path = tmp_path_factory.mktemp("page") / "a.h5"
    hidden = {"mask_shift": {"dx": 0.61, "dy": -0.35}, "column_noise": {"std": 0.02}}
    write_captures(path, capture_session(Session(size=(32, 40)), hidden, seed=3))
    few = {name: vocabulary()[name] for name in ("mask_shift", "column_noise", "gain", "shot_noise", "read_noise")}
    return diagnose(read_captures(path), few)


def page(found: Diagnosis, **more: Any) -> str:
    report = describe(found) | {"runtime_s": 1.5} | more
    return report_page(found, report, figures(found), "python -m sci_lightning.diagnose captures='<a>.h5'")


class Tags(HTMLParser):
    """Complains of elements that are not closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_it_is_well_formed_and_needs_nothing_else(found: Diagnosis) -> None:
    text = page(found)
    tags = Tags()
    tags.feed(text)
    assert not tags.open
    assert not re.search(r"<script|<link|@import|src=", text)
    assert not re.search(r'href="(?!#|data:)', text)
    assert "$" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)


def test_it_says_what_was_found(found: Diagnosis) -> None:
    text = page(found)
    assert re.search(
        r"<h1>The mask&#x27;s image is displaced by \(0\.6.* ± .*, \u22120\.3.* pixel and columns differ", text
    )
    command = "captures=&#x27;&lt;a&gt;.h5"
    for words in ("column_noise", "95 % interval", "Estimated map of column_noise", command, "1.5 s"):
        assert words in text, words
    for test in found.where["after"]:
        assert f"<td>{test.name}</td>" in text


def test_what_is_left_and_what_to_do(found: Diagnosis) -> None:
    other = replace(found, unnamed=(Unnamed("ghost", "optics", "a second image", 1e-20, 99.0, torch.rand(32, 40)),))
    report = describe(other)
    report["effects"][0] |= {"alternatives": ["mask_scale"], "tell_apart": "a single pattern"}
    text = page(other, effects=report["effects"], next_captures=["a dark frame of four times the exposure"])
    assert "optics: a second image (p 1e-20)" in text
    assert "cannot tell <b>mask_shift</b> from mask_scale" in text
    assert "<li>a dark frame of four times the exposure</li>" in text
    assert report["unnamed"][0]["picture"] == "unnamed_1.png"


def test_a_page_of_a_camera_in_which_nothing_is_hidden(tmp_path: Path) -> None:
    write_captures(tmp_path / "a.h5", capture_session(Session(size=(32, 32)), {}, seed=3))
    few = {name: vocabulary()[name] for name in ("gain", "shot_noise", "read_noise")}
    text = page(diagnose(read_captures(tmp_path / "a.h5"), few))
    assert "<h1>The captures agree with the ideal camera" in text
    assert "No effect is worth its parameters" in text
