"""Lines for a person: in order, and of no consequence for who tells them."""

import threading
import time

from dtbacklash.remote.server import LINES, Teller


def test_lines_come_in_order_and_all_of_them_before_the_end() -> None:
    said: list[str] = []
    teller = Teller(said.append)
    for i in range(100):
        teller(str(i))
    teller.close()
    assert said == [str(i) for i in range(100)]


def test_a_broken_pipe_ends_nothing() -> None:
    said: list[str] = []

    def say(line: str) -> None:
        if line == "broken":
            raise BrokenPipeError
        said.append(line)

    teller = Teller(say)
    for line in ("before", "broken", "after"):
        teller(line)
    teller.close()
    assert said == ["before", "after"]


def test_a_terminal_that_stands_still_keeps_nobody() -> None:
    go_on = threading.Event()
    teller = Teller(lambda line: go_on.wait(30.0) and None)
    began = time.monotonic()
    for i in range(2 * LINES):
        teller(str(i))
    assert time.monotonic() - began < 5.0
    go_on.set()
    teller.close()
