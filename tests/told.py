"""What is said: a command's stderr without its progress, which comes only where the machine is slow; and refusals."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from dtbacklash import cli
from dtbacklash.errors import UserError

PROGRESS = re.compile(r"dtb: .*, \d+ %, .+ gone(, about .+ left)?\n")


def without_progress(err: str) -> str:
    """Stderr of a command without the lines that say every ten seconds where it stands."""
    return "".join(line for line in err.splitlines(keepends=True) if not PROGRESS.fullmatch(line))


@contextmanager
def refused(*words: str, start: str = "", key: str | None = None, whole: str | None = None) -> Iterator[None]:
    """What is done here is refused in one line, with exit code 2. words : what it has. key : what it is about."""
    with pytest.raises(UserError) as caught:
        yield
    line = str(caught.value)
    assert [word for word in words if word not in line] == [], line
    assert line.startswith(start)
    assert key in (None, caught.value.key)
    assert whole in (None, line)
    assert "\n" not in line
    assert caught.value.exit_code == 2


def refusal(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What ``dtb`` says where it refuses these words: one line on stderr, exit code 2."""
    capsys.readouterr()
    code = cli.main(list(words))
    return one_line((code, *capsys.readouterr()))


def one_line(answer: tuple[int, str, str]) -> str:
    """What a command says that refuses its words, of its exit code, stdout and stderr."""
    code, out, err = answer
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert err.startswith("dtb: error: ")
    return err.removeprefix("dtb: error: ")
