"""The add-on's pass names: what Blender and EXR files can hold, unique and lasting."""

from __future__ import annotations

import random

import addon  # noqa: F401 - first: it makes the next importable
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blender_addon.names import AO_PASS, MAX_BYTES, PREFIX, pass_names

LIGHT_NAMES = st.lists(st.text(min_size=1, max_size=63), unique=True, max_size=12)


def test_plain_names_are_kept() -> None:
    assert pass_names(["Key", "Rim light"]) == ("Shadow Key", "Shadow Rim light")
    assert pass_names([]) == ()


def test_dots_and_control_characters_give_way() -> None:
    assert pass_names(["Light.001", "a\nb"]) == ("Shadow Light_001", "Shadow a_b")


def test_emoji_and_umlauts_stay() -> None:
    assert pass_names(["💡 Küche", "灯"]) == ("Shadow 💡 Küche", "Shadow 灯")


def test_who_needs_no_change_keeps_its_name() -> None:
    assert pass_names(["Light.001", "Light_001"]) == ("Shadow Light_001 2", "Shadow Light_001")


def test_long_names_are_cut_between_characters() -> None:
    (name,) = pass_names(["💡" * 15])
    assert name == PREFIX + "💡" * 10
    assert len(name.encode()) <= MAX_BYTES


def test_long_names_that_differ_at_their_ends() -> None:
    names = pass_names(["a" * 60 + end for end in "xyz"])
    assert len(set(names)) == 3
    assert names[0].endswith("a") and names[1].endswith("a 2") and names[2].endswith("a 3")


@pytest.mark.parametrize("names", [["x.1", "x_1", "x_1 2"], ["x_1 2", "x.1", "x-1", "x_1"]])
def test_a_number_that_is_taken_is_not_given(names: list[str]) -> None:
    assert len(set(pass_names(names))) == len(names)
    assert f"{PREFIX}x_1 2" == pass_names(names)[names.index("x_1 2")]


@given(LIGHT_NAMES)
def test_what_holds_for_all_names(names: list[str]) -> None:
    passes = pass_names(names)
    assert len(set(passes)) == len(names)
    for name in passes:
        assert "." not in name and name.isprintable()
        assert name.startswith(PREFIX) and name != AO_PASS
        assert len(name.encode()) <= MAX_BYTES


@given(LIGHT_NAMES, st.integers())
def test_order_does_not_matter(names: list[str], seed: int) -> None:
    shuffled = random.Random(seed).sample(names, len(names))
    assert dict(zip(names, pass_names(names), strict=True)) == dict(
        zip(shuffled, pass_names(shuffled), strict=True)
    )
