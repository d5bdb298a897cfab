"""Errors keep their data and say what is known."""

from __future__ import annotations

from pips_drake.errors import InputError, NotFollowableError, PipsError, UnknownNameError


def test_an_unknown_name_keeps_what_was_asked_and_lists_the_known_names_in_order():
    error = UnknownNameError("arm", "prototpe", ["zeta", "prototype"])
    assert (error.kind, error.name, error.known) == ("arm", "prototpe", ["prototype", "zeta"])
    assert str(error) == (
        "unknown arm 'prototpe' (did you mean 'prototype'?); known: prototype, zeta"
    )


def test_a_name_that_resembles_none_gets_no_guess():
    assert (
        str(UnknownNameError("arm", "xyz", ["prototype"])) == "unknown arm 'xyz'; known: prototype"
    )
    assert str(UnknownNameError("arm", "xyz", [])) == "unknown arm 'xyz'; known: none"


def test_a_path_that_cannot_be_followed_says_where():
    error = NotFollowableError("too far", 4.5)
    assert str(error) == "too far"
    assert error.tip_arc_length == 4.5
    assert NotFollowableError("no posture").tip_arc_length is None


def test_bad_input_and_a_negative_answer_are_told_apart():
    assert issubclass(UnknownNameError, InputError)
    assert issubclass(InputError, PipsError)
    assert issubclass(NotFollowableError, PipsError)
    assert not issubclass(NotFollowableError, InputError)
