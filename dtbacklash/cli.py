"""The command line: ``dtb <command> ...``. Heavy imports happen only inside a command.

Exit codes: 0 done; 1 the command ran and something in it failed; 2 wrong input; 130 interrupted (Ctrl-C, or SIGTERM).
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys

from dtbacklash.config.grammar import EXPORT, GRAMMARS
from dtbacklash.errors import UserError
from dtbacklash.version import __version__

#: what asks for help, behind a command or in its place
HELP = ("-h", "--help", "help")
#: command -> what it does; all but five are applications of Hydra
COMMANDS = {
    **{name: grammar.summary for name, grammar in GRAMMARS.items()},
    EXPORT.name: EXPORT.summary,
    "benchmark": "make a benchmark that any tool can enter, and score a tool's answers",
    "effects": "list the physics that there is: laws, units, where they may act",
    "recordings": "list the public recordings that have a mapping, and fetch them",
    "rig": "a rig of your own: write one to begin with, and check one",
    "twin": "the digital twin over a network: serve it, and its status",
}
#: the commands of a diagnosis stand first
FIRST = ("diagnose", "rig", "recordings", "effects")


def usage() -> str:
    """Return the text of ``dtb --help``."""
    lines = ["dtb: why a machine's recording differs from its simulation, and what physics is missing;"]
    lines += ["drives with growing backlash, their controllers and their digital twins", ""]
    width = max(map(len, COMMANDS))
    lines += ["usage: dtb <command> [key=value ...]", "", "commands:"]
    lines += [f"  {name:<{width}}  {COMMANDS[name]}" for name in dict.fromkeys((*FIRST, *COMMANDS))]
    lines += ["", "dtb <command> --help lists its settings; dtb --version prints the version;"]
    lines += ["dtb --install-completion lets the shell complete commands, settings and choices (bash, zsh)."]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run ``dtb``; every mistake of the user ends in one line on stderr. Returns the exit code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        return _dispatch(words)
    except UserError as error:
        return fail(str(error), error.exit_code)
    except KeyboardInterrupt as interrupt:
        print(f"dtb: interrupted{interrupt}", file=sys.stderr)
        exec("")  # else Python kills itself by SIGINT at its end, if what was interrupted was run from a text
        return 130
    except BrokenPipeError:
        # the reader of our output (head, less) has gone: not an error, but nothing more can be printed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def fail(line: str, exit_code: int = 2) -> int:
    """Print one error line and return the exit code: by default that of wrong input."""
    print("dtb: error: " + " ".join(line.split()), file=sys.stderr)
    return exit_code


def _dispatch(words: list[str]) -> int:
    name, *rest = words or ["--help"]
    if name in HELP:
        print(usage())
        return 0
    if name in ("-V", "--version"):
        print(f"dtb {__version__}")
        return 0
    if name in ("--install-completion", "--show-completion", "--complete"):
        from dtbacklash.commands import completion

        return completion.main(words)
    if name not in COMMANDS:
        from dtbacklash.config.near import meant

        raise UserError("command", name, meant(name, COMMANDS) + "choose one of " + ", ".join(COMMANDS))
    if any(word in HELP for word in rest):
        from dtbacklash.commands.help import of_command

        print(of_command(name, rest))
        return 0
    if name in GRAMMARS:
        from dtbacklash.commands import hydra_task

        return hydra_task.main(name, rest)
    done: int = importlib.import_module(f"dtbacklash.commands.{name}").main(rest)
    return done


def one_blas_thread() -> None:
    """Keep the libraries of linear algebra to one thread, unless the user says otherwise; before numpy is loaded.

    All matrices here are tiny. With threads, L-BFGS-B took up to 0.2 s instead of 4 ms on a busy machine, and the jobs
    of a sweep would compete for the cores.
    """
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


#: the libraries are half a million objects that live to the end: looking through them again and again took 5 % of a run
GARBAGE_AFTER = 50_000


def entry() -> None:
    """Entry point of the installed script."""
    one_blas_thread()
    gc.set_threshold(GARBAGE_AFTER)
    # `timeout`, a batch system, a container that stops: as tidy as Ctrl-C, no worker and no half result is left behind
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())


if __name__ == "__main__":
    entry()
