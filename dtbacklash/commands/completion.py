"""Completion of the command line: ``dtb --install-completion``, and what the shell asks at each Tab.

The shell's script asks ``dtb --complete LINE``, which is answered from the grammars, without Hydra.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from dtbacklash.commands.help import PARTED
from dtbacklash.config.grammar import EXPORT, FILES, FOLDER_WORD, GRAMMARS, Grammar
from dtbacklash.config.groups import LAUNCHER, LAUNCHER_NAMES, MACHINES, options, recordings
from dtbacklash.config.setting import declared
from dtbacklash.errors import UserError

SHELLS = ("bash", "zsh")
OPTIONS = ("--help", "--cfg", "-m", "-v")
#: the word that follows a command which is no application
SECOND = {
    "effects": ("rig=",), "recordings": ("fetch",), EXPORT.name: ("fmu", "controller"), "rig": ("new", "check"),
    **{name: tuple(parts) for name, parts in PARTED.items()},
}  # fmt: skip
SCRIPT = """\
# completion of dtb; made by `dtb --install-completion`
_dtb_completion() {
    local word="${COMP_LINE:0:COMP_POINT}" found shown cut
    found=$(dtb --complete "$word" 2>/dev/null) || return
    word="${word##* }"
    # bash replaces only what follows the last = or : of the word
    cut="${word%"${word##*[=:]}"}"
    COMPREPLY=()
    while IFS= read -r shown; do
        [[ -n "$shown" ]] && COMPREPLY+=("${shown#"$cut"}")
    done <<< "$found"
    [[ ${#COMPREPLY[@]} -eq 1 && "${COMPREPLY[0]}" == *[=./] ]] && compopt -o nospace 2>/dev/null
    return 0
}
complete -o bashdefault -o default -F _dtb_completion dtb
"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\nautoload -U +X compinit && compinit\n"


def main(words: list[str]) -> int:
    """Run ``dtb --install-completion [SHELL]``, ``--show-completion [SHELL]`` or ``--complete LINE``."""
    option, *rest = words
    if option == "--complete":
        line = rest[0] if rest else "dtb "
        print("\n".join(answers(line)))
        return 0
    shell = rest[0] if rest else Path(os.environ.get("SHELL", "bash")).name
    if shell not in SHELLS:
        raise UserError("shell", shell, "choose one of " + ", ".join(SHELLS))
    if option == "--show-completion":
        print(script(shell), end="")
        return 0
    return _install(shell)


def script(shell: str) -> str:
    """What the shell reads to know how ``dtb`` is completed."""
    return (ZSH if shell == "zsh" else "") + SCRIPT


def _install(shell: str) -> int:
    """Write the script where the shell looks for it, or say what to add to its start file."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    file = data / "bash-completion" / "completions" / "dtb" if shell == "bash" else data / "dtbacklash" / "dtb.zsh"
    from dtbacklash.files import reason

    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(script(shell), encoding="utf-8")
    except OSError as error:
        raise UserError("shell", shell, f"{file} cannot be written: {reason(error)}") from error
    print(f"completion of dtb is in {file}")
    if shell == "bash":
        print("new shells have it if the package bash-completion is there; else add to ~/.bashrc, or for this shell:")
    else:
        print("add to ~/.zshrc, or for this shell:")
    print(f"  source {file}")
    return 0


def answers(line: str) -> list[str]:
    """The words that may stand where the line ends.

    line : from its beginning, with ``dtb``, to the cursor.
    """
    *before, word = line.split(" ")
    given = [one for one in before if one]
    if len(given) <= 1:
        return _beginning(word, [*GRAMMARS, *SECOND, "--help", "--version", "--install-completion"])
    command, rest = given[1], given[2:]
    if command in SECOND and not rest:
        return _beginning(word, SECOND[command])
    if command == "rig":
        return _beginning(word, MACHINES if rest == ["new"] else options("rig") if rest == ["check"] else ())
    if command in PARTED:
        return _of_part(command, rest, word)
    if command == EXPORT.name and rest[0] == "controller":
        return answers(" ".join(["dtb", "run", *rest[1:], word]))
    if command in FILES:
        rest = rest[1:]
    elif command not in GRAMMARS:
        return _beginning(word, recordings() if command == "recordings" else ())
    return _of_grammar((GRAMMARS | FILES)[command], word)


def _of_part(command: str, rest: list[str], word: str) -> list[str]:
    """The settings of a part of a command; ``dtb twin describe`` takes those of a run."""
    parts = PARTED[command]
    if (command, rest[0]) == ("twin", "describe"):
        return answers(" ".join(["dtb", "run", *rest[1:], word]))
    schema = parts[rest[0]].schema if rest[0] in parts else None
    return [] if schema is None else _beginning(word, [f"{one.key}=" for one in declared(schema)])


def _of_grammar(grammar: Grammar, word: str) -> list[str]:
    """Options, choices, and settings down to the next dot."""
    key, equals, _ = word.partition("=")
    key = grammar.words.get(key, key)
    if word.startswith("-"):
        return _beginning(word, [*OPTIONS, *grammar.flags])
    if not equals:
        groups = [f"{one}=" for one in (*grammar.groups, LAUNCHER, FOLDER_WORD, *grammar.words)]
        settings = [one if "." not in one[len(word) :] else one[: one.index(".", len(word)) + 1]
                    for one in (f"{key}=" for key in grammar.settings)]  # fmt: skip
        return sorted(set(_beginning(word, [*groups, *settings])))
    if key == "recording.source":
        choices = recordings()
    elif key == LAUNCHER:
        choices = LAUNCHER_NAMES
    elif key in grammar.groups:
        choices = options(key)
    elif key in grammar.settings:
        one = grammar.settings[key]
        choices = ["true", "false"] if one.kind is bool else list(one.about.choices)
    else:
        return []
    return _beginning(word, [f"{word.partition('=')[0]}={choice}" for choice in choices])


def _beginning(word: str, answers: Iterable[str]) -> list[str]:
    return [one for one in answers if one.startswith(word)]
