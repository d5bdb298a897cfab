"""The silence of a first run is explained, on a terminal and once."""

from __future__ import annotations

import io
import sys
from collections import defaultdict

import numba
import pytest
from numba.core import event

from pips_drake.command_line import tell_of_compiling


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def no_listeners(monkeypatch):
    """What the function registers goes with the test."""
    monkeypatch.setattr(event, "_registered", defaultdict(list))


def compile_something() -> None:
    for constant in (1, 2):
        assert numba.njit(lambda x, c=constant: x + c)(1) == 1 + constant


def test_a_terminal_is_told_once_when_something_is_compiled(monkeypatch, no_listeners):
    monkeypatch.setattr(sys, "stderr", said := Terminal())
    tell_of_compiling()
    assert said.getvalue() == ""
    compile_something()
    assert said.getvalue().startswith("pips: compiling")
    assert said.getvalue().count("\n") == 1


def test_a_log_is_told_nothing(monkeypatch, no_listeners):
    monkeypatch.setattr(sys, "stderr", said := io.StringIO())
    tell_of_compiling()
    compile_something()
    assert said.getvalue() == ""
