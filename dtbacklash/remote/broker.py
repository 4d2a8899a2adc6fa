"""Mosquitto on this machine, on 127.0.0.1 only, with the users and rules of a folder of ``dtb twin access``."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from dtbacklash.config.twin import BrokerConfig
from dtbacklash.errors import Failure, UserError
from dtbacklash.remote.access import ACL, PASSWORDS, configuration, program, write

Say = Callable[[str], None]
STOP_S = 5.0
#: what ends it; a terminal that is closed hangs up, which Mosquitto itself takes for "read the configuration again"
ENDS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def run(config: BrokerConfig, say: Say) -> int:
    """Run the broker until it is told to end; 0 if it ended so.

    Raises
    ------
    UserError : Mosquitto is not installed, the port is taken, the folder is none of ``dtb twin access``.
    Failure : the broker ended by itself.
    """
    mosquitto, folder = program("mosquitto"), Path(config.access).absolute()
    _check_port(config.port)
    if not folder.exists():
        for path, what in write(folder, ["machine"]):
            say(f"{path}: {what}")
    if not (folder / PASSWORDS).is_file() or not (folder / ACL).is_file():
        raise UserError("access", config.access, "a folder of dtb twin access, or a new one")
    with tempfile.TemporaryDirectory() as scratch:
        conf = Path(scratch) / "mosquitto.conf"
        # as root it would become a user of its own, who may not read the folder
        user = "root" if hasattr(os, "geteuid") and os.geteuid() == 0 else None
        conf.write_text(configuration(folder, config.port, user), encoding="utf-8")
        words = [mosquitto, "-c", str(conf)]
        process = subprocess.Popen(words, start_new_session=True, preexec_fn=_ends_with_us())  # noqa: PLW1509 (one thread)
        told: list[int] = []

        def end(number: int, _frame: object) -> None:
            told.append(number)
            process.terminate()

        before = {number: signal.signal(number, end) for number in ENDS}
        say(f"Mosquitto on 127.0.0.1:{config.port}, users and rules of {folder}; Ctrl-C ends it")
        try:
            code = process.wait()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            _stop(process)
    if told:
        return 0
    raise Failure("broker", f"127.0.0.1:{config.port}", f"Mosquitto has ended by itself, with exit code {code}")


def _ends_with_us() -> Callable[[], None] | None:
    """What a new process does first, to be ended when this one is, even by SIGKILL; None where there is no such thing.

    See prctl(2), PR_SET_PDEATHSIG.
    """
    if sys.platform != "linux":
        return None
    prctl, us = ctypes.CDLL(None).prctl, os.getpid()

    def promise() -> None:
        prctl(1, int(signal.SIGTERM), 0, 0, 0)
        if os.getppid() != us:  # too late
            os._exit(0)

    return promise


def _check_port(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise UserError("port", port, f"cannot be had: {(error.strerror or str(error)).lower()}") from error


def _stop(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
