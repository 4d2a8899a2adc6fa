"""YAML of users: data, in a moment, without anything of the machine's."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtbacklash import yaml_files
from dtbacklash.yaml_files import Mistake, read

NINE = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join(['*' + old] * 9)}]\n" for old, new in zip("abcdefghijk", "bcdefghijkl", strict=True)
)


def test_what_people_write():
    text = "a: 1e-3\nb: 5.0e-6\nc: .5\nd: 3\ne: true\nf: 2024-01-02\ng: text\nh:\nx: &x {y: 1}\nz: {<<: *x, y: 2}\n"
    assert read(text) == {
        "a": 1e-3, "b": 5e-6, "c": 0.5, "d": 3, "e": True, "f": "2024-01-02", "g": "text", "h": None, "x": {"y": 1},
        "z": {"y": 2},
    }  # fmt: skip
    assert read(b"\xef\xbb\xbfa: 1") == {"a": 1}
    assert read("") is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (NINE, "too many aliases"),
        ("a: &a [*a]", "alias of something that it is part of"),
        ("[" * 5000, "nested more than 40 deep"),
        ("- " * 100_000, "nested more than 40 deep"),
        ("a: ${oc.env:HOME}", "${...} is not resolved in a file"),
        ("a: {b: '${c.d}'}", "at a.b; ${...} is not resolved"),
        ("${oc.env:HOME}: 1", "is not resolved"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: 1\na: 2", "gives the key a twice (line 2)"),
        ("a: [1", "is not valid YAML: expected ',' or ']'"),
        ("a: " + "9" * 10_000, "cannot be read"),
        ("a: 0x" + "f" * 2000, "more than 300 digits at a"),
        ("!!set {a, b}", "holds a set"),
        ("? [1, 2]\n: 3", "a key must be a word"),
        ("--- a\n--- b", "another document"),
        (b"\xff\xfe", "must be text in UTF-8"),
        ("a: " + "x" * (5 << 20), "is too large"),
    ],
)
def test_what_cannot_be_used_is_one_line_in_a_moment(text, said):
    began = time.perf_counter()
    with pytest.raises(Mistake) as caught:
        read(text)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert time.perf_counter() - began < 5.0


def test_a_file_for_another_reader_may_refer_to_settings_but_not_to_the_environment():
    yaml_files.check(b"a: ${b.c}")
    yaml_files.check(b"a: ${now:%Y}", resolvers=True)
    for text in (b"a: ${oc.env:HOME}", b"a: ${${b}:HOME}", NINE.encode(), b"a: [", b"\xff"):
        with pytest.raises(Mistake):
            yaml_files.check(text)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.text(alphabet="ab:-{}[]&*!<>|'\"\n ,1.e${}#?%~", max_size=80))
def test_nothing_but_a_mistake_comes_out_of_garbage(text):
    try:
        read(text)
    except Mistake as mistake:
        assert "\n" not in str(mistake)  # noqa: PT017
