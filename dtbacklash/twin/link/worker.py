"""The process of a :class:`.background.BackgroundTwin`: requests in by stdin, answers out by stdout, pickled."""

from __future__ import annotations

import os
import pickle
import sys
from typing import BinaryIO

from dtbacklash import source_hash
from dtbacklash.twin.link.service import Answer, Answering, Request

#: how much this process stands back behind the loop (0 to 19)
NICE = 10


def main() -> None:
    """Take a twin, say that it is ready and of which code, then answer requests until there are no more."""
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    _stand_back()
    serve(requests, answers)


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """See :func:`main`; ends with its input."""
    try:
        twin: Answering = pickle.load(requests)
        twin.warm_up()
        _send(answers, source_hash.digest())
        while True:
            _send(answers, _answer(twin, pickle.load(requests)))
    except (EOFError, BrokenPipeError):
        return


def _answer(twin: Answering, request: Request) -> Answer | str:
    """The answer, or why there is none: one buffer that cannot be estimated does not end the twin."""
    try:
        return twin.answer(request)
    except Exception as error:
        return f"cannot be estimated: {error}"


def _stand_back() -> None:
    """Leave the processor to the loop, also where that runs at a priority of real time, which a child inherits."""
    if sys.platform != "win32":
        if hasattr(os, "sched_setscheduler"):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.nice(NICE)


def _send(answers: BinaryIO, what: object) -> None:
    pickle.dump(what, answers)
    answers.flush()


if __name__ == "__main__":
    main()
