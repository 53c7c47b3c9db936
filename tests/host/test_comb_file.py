"""A comb file reads as the comb that it describes, or as one sentence that says what is wrong."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ribbonhost.comb import SAME_PLACE_M, Comb, CombRibbon, load_comb, parse_comb
from ribbonhost.errors import CombFileError

A, B, C, D = ("a" * 24, "b" * 24, "c" * 24, "d" * 24)
HEAD = f'[comb]\nreference = "{A}"\npitch_m = 0.025\n'
RIBBONS = f'[[ribbon]]\nserial = "{B}"\nstart_m = 0.0\n[[ribbon]]\nserial = "{C}"\nstart_m = 0.15\n'


def test_a_comb_file_reads_as_what_it_says() -> None:
    text = HEAD + 'slots = 32\nparts = ["LIS2DW12", "mmc5983ma"]\n' + RIBBONS + 'name = "left"\n'
    assert parse_comb(text) == Comb(
        A,
        0.025,
        (CombRibbon(B, 0.0), CombRibbon(C, 0.15, "left")),
        slots=32,
        parts=frozenset({"lis2dw12", "mmc5983ma"}),
    )


def test_ribbons_are_sorted_by_where_they_start_and_serials_may_be_upper_case() -> None:
    comb = Comb(A, 0.025, (CombRibbon(B, 0.3), CombRibbon(C, 0.1)))
    assert comb.serials == (A, C, B)
    assert parse_comb(HEAD + RIBBONS.replace(B, B.upper())).serials == (A, B, C)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "[[ribbon]\n", r"is not TOML: .*line 4"),
        ("", "comb is missing in the file"),
        ("comb = 3\n", "comb must be a table"),
        (HEAD, "0 of at least 2"),
        (HEAD + f'[[ribbon]]\nserial = "{B}"\nstart_m = 0\n', "1 of at least 2"),
        (HEAD + "[ribbon]\nserial = 1\n", r"must be a list of tables: \[\[ribbon\]\]"),
        (HEAD + RIBBONS + "lenght_m = 1\n", r'unknown key "lenght_m" in \[\[ribbon\]\] number 2'),
        (HEAD + "pich = 1\n" + RIBBONS, r'unknown key "pich" in \[comb\]'),
        (HEAD + RIBBONS + "[extra]\n", 'unknown key "extra" in the file'),
        (HEAD.replace("pitch_m = 0.025\n", "") + RIBBONS, r"pitch_m is missing in \[comb\]"),
        (HEAD.replace("0.025", "0") + RIBBONS, "pitch_m = 0 is not between"),
        (HEAD.replace("0.025", "nan") + RIBBONS, "pitch_m = nan is not between"),
        (HEAD.replace("0.025", '"wide"') + RIBBONS, "pitch_m of .* must be a number"),
        (HEAD.replace("0.025", "1" + "0" * 400) + RIBBONS, "pitch_m of .* is no length"),
        (HEAD.replace("0.025", "true") + RIBBONS, "pitch_m of .* must be a number"),
        (HEAD + "slots = 2.5\n" + RIBBONS, "slots of .* must be a whole number"),
        (HEAD + "slots = 2\n" + RIBBONS, "at least 4 sensors"),
        (HEAD + "parts = 3\n" + RIBBONS, "parts of .* must be a list"),
        (HEAD + "slots = 4\n" + RIBBONS, "starts at 0.15 m, beyond the end of the reference at 0.075 m"),
        (HEAD + RIBBONS.replace("0.15", "-0.15"), "starts at -0.15 m: not 0 or more"),
        (HEAD + RIBBONS.replace("0.15", "inf"), "starts at inf m: not 0 or more"),
        (HEAD + RIBBONS.replace("0.15", "0.0004"), "both start at 0.0004 m"),
        (HEAD + RIBBONS.replace(C, B), f"ribbon {B} is in the file twice"),
        (HEAD + RIBBONS.replace(C, A), f"ribbon {A} is in the file twice"),
        (HEAD + RIBBONS.replace(C, "xyz"), 'serial "xyz" is not 24 hexadecimal digits'),
        (HEAD + RIBBONS.replace(f'"{C}"', "12"), "serial of .* must be text in quotes"),
    ],
)
def test_every_mistake_is_one_sentence_with_exit_code_2(text: str, message: str) -> None:
    with pytest.raises(CombFileError, match=message) as error:
        parse_comb(text)
    assert error.value.exit_code == 2
    assert "\n" not in str(error.value)


def test_a_mistake_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "desk.toml"
    path.write_text(HEAD)
    with pytest.raises(CombFileError, match=r"desk\.toml: a surface spans"):
        load_comb(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(CombFileError, match=r"desk\.toml: is not text in UTF-8"):
        load_comb(path)
    with pytest.raises(CombFileError, match=r"none\.toml: cannot be read: No such file"):
        load_comb(tmp_path / "none.toml")


names = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
serials = st.lists(st.binary(min_size=12, max_size=12).map(bytes.hex), min_size=3, max_size=7, unique=True)


@given(
    serials=serials,
    name=names,
    label=names,
    step_m=st.floats(SAME_PLACE_M * 2, 1),
    slots=st.none() | st.just(512),
)
def test_what_is_written_reads_as_the_same_comb(
    serials: list[str], name: str, label: str, step_m: float, slots: int | None
) -> None:
    ribbons = tuple(CombRibbon(serial, i * step_m, label) for i, serial in enumerate(serials[1:]))
    comb = Comb(serials[0], 0.025, ribbons, name, slots=slots, parts=frozenset({"lis2dw12"}))
    assert parse_comb(comb.to_toml()) == comb


@given(st.text(max_size=200))
def test_any_text_reads_as_a_comb_or_a_mistake(text: str) -> None:
    try:
        comb = parse_comb(HEAD + text)
    except CombFileError:
        return
    assert math.isfinite(comb.pitch_m)
