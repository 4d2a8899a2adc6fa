"""A twin in a process of its own on this machine: the loop goes on while it works.

Not a thread: an estimate is Python for the greater part, and would keep the interpreter from the loop for milliseconds.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Thread
from types import TracebackType
from typing import IO

from dtbacklash import source_hash
from dtbacklash.errors import Failure, UserError
from dtbacklash.twin.link.service import Answer, Answering, Reply, Request

COMMAND = (sys.executable, "-m", "dtbacklash.twin.link.worker")
GONE = "the twin's process has ended"
#: vectors are short: threads of the linear algebra would take the loop's core
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


@dataclass
class BackgroundTwin:
    """A :class:`~.service.TwinService`; used in a ``with``, at whose end the process is gone.

    A thread hands over the requests, one after the other, and takes the answers: the loop never waits for a pipe.
    """

    twin: Answering
    _process: subprocess.Popen[bytes] | None = None
    _requests: SimpleQueue[Request | None] = field(default_factory=SimpleQueue)
    _replies: deque[Reply] = field(default_factory=deque)
    _thread: Thread | None = None

    def __enter__(self) -> BackgroundTwin:
        """Start the process; it gets ready meanwhile."""
        # a session of its own: Ctrl-C is for the loop, which then ends the process
        self._process = subprocess.Popen(
            COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, env=os.environ | ONE_THREAD
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is None:
            return
        self._requests.put(None)
        self._process.kill()
        self._process.wait()
        if self._thread is not None:
            self._thread.join()
        for pipe in self._pipes():
            with suppress(OSError):  # what was still to be written
                pipe.close()

    def warm_up(self) -> None:
        """Wait until the process is ready.

        Raises
        ------
        UserError : it does not know an effect that is registered here. Failure : it does not start.
        """
        to, back = self._pipes()
        try:
            _send(to, self.twin)
            code = pickle.load(back)
        except (OSError, EOFError) as error:
            raise Failure("pace", "real", "the twin's process cannot be started") from error
        if code != source_hash.digest():
            raise UserError("pace", "real", "is for the effects of the package: the twin's process knows no others")
        self._thread = Thread(target=self._exchange, daemon=True)
        self._thread.start()

    def ask(self, request: Request) -> None:
        """See :class:`.service.TwinService`."""
        self._requests.put(request)

    def replies(self) -> list[Reply]:
        """See :class:`.service.TwinService`."""
        return [self._replies.popleft() for _ in range(len(self._replies))]

    def _pipes(self) -> tuple[IO[bytes], IO[bytes]]:
        assert self._process is not None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._process.stdin, self._process.stdout

    def _exchange(self) -> None:
        """The thread: request after request, each with its reply."""
        to, back = self._pipes()
        while (request := self._requests.get()) is not None:
            said: Answer | str
            try:
                _send(to, request)
                said = pickle.load(back)
            except Exception:  # a pipe that ends anywhere in a pickle may raise anything
                said = GONE
            self._replies.append(Reply(request, None, said) if isinstance(said, str) else Reply(request, said))


def _send(to: IO[bytes], what: object) -> None:
    pickle.dump(what, to)
    to.flush()
