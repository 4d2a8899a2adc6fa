"""Who may speak: user, password or certificate for the broker, and the key that signs the messages.

They come from a file that nobody else may read, or from the environment; never from a setting, so that no
configuration, log or report holds them.

A signature is HMAC-SHA256 with the key of one machine, over the topic and the bytes of the message. A machine's key
is made from the twin's key and the machine's name: a machine that is broken into can sign for no other.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import re
import secrets
import stat
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from dtbacklash.errors import UserError

PASSWORD, KEY, USER = "DTB_TWIN_PASSWORD", "DTB_TWIN_KEY", "DTB_TWIN_USER"
#: user property of a message that holds its signature
PROPERTY = "hmac-sha256"
MADE_FOR = b"dtbacklash-twin/1\n"
#: whose key signs the status of a twin; no machine has such a name
STATUS = ".status"
_KEY = re.compile(r"(?:(\.status|[A-Za-z0-9_-]{1,64}):)?([0-9a-f]{64})")
FIELDS = ("user", "password", "key", "ca_file", "cert_file", "cert_key_file")


@dataclass(frozen=True)
class Key:
    """The twin's key, or that of one machine. Never printed."""

    secret: bytes = field(repr=False)
    machine: str | None = None

    @classmethod
    def parsed(cls, text: str, where: str) -> Key:
        """From ``64 hexadecimal digits``, or ``MACHINE:digits``.

        Raises UserError: it is something else; without what was given.
        """
        found = _KEY.fullmatch(text.strip())
        if not found:
            raise UserError(where, "...", "a key is 64 hexadecimal digits, before them MACHINE: where it is one's own")
        return cls(bytes.fromhex(found[2]), found[1])

    @classmethod
    def drawn(cls) -> Key:
        """A new key of a twin."""
        return cls(secrets.token_bytes(32))

    def of_machine(self, machine: str) -> Key:
        """The key that signs what a machine says and hears, or (STATUS) how the twin is.

        Raises UserError: this is the key of another machine.
        """
        if self.machine is None:
            return Key(hmac.digest(self.secret, b"machine " + machine.encode(), "sha256"), machine)
        if self.machine != machine:
            raise UserError("key", "...", f"is that of {self.machine}; needed is that of {machine}, or of the twin")
        return self

    def text(self) -> str:
        """As it stands in a file."""
        return f"{self.machine}:{self.secret.hex()}" if self.machine else self.secret.hex()

    def sign(self, topic: str, payload: bytes) -> str:
        """The signature of a message, in hexadecimal digits."""
        mac = hmac.new(self.secret, MADE_FOR + topic.encode() + b"\n", hashlib.sha256)
        mac.update(payload)
        return mac.hexdigest()

    def signed(self, topic: str, payload: bytes, signature: str | None) -> bool:
        """Whether a signature is that of a message; compared in constant time."""
        given = (signature or "").encode("utf-8", "replace")
        return hmac.compare_digest(self.sign(topic, payload).encode(), given)


@dataclass(frozen=True)
class Credentials:
    """What a participant shows to the broker, and its key. Never printed."""

    key: Key | None = field(repr=False, default=None)
    user: str | None = None
    password: str | None = field(repr=False, default=None)
    ca_file: str | None = None
    cert_file: str | None = None
    cert_key_file: str | None = None

    def needed_key(self, setting: str) -> Key:
        """The key; raises UserError where there is none."""
        if self.key is None:
            allowed = f"no key in it nor in ${KEY}: messages have to be signed; docs/remote.md makes credentials"
            raise UserError(setting, "..." if self.user else "null", allowed)
        return self.key


def load_credentials(file: str | None, setting: str) -> Credentials:
    """From a file of mode 600, and from the environment, which comes first.

    file : YAML with the keys of FIELDS; None: the environment alone. setting : the one to name in errors.

    Raises UserError: others may read the file; it is none, or holds something else.
    """
    found = {} if file is None else _read(Path(file), setting)
    for name, variable in (("user", USER), ("password", PASSWORD), ("key", KEY)):
        if value := os.environ.get(variable):
            found[name] = value
    where = f"${KEY}" if os.environ.get(KEY) else setting
    key = Key.parsed(found.pop("key"), where) if "key" in found else None
    return Credentials(key, **found)


def _read(path: Path, setting: str) -> dict[str, str]:
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no text"
        raise UserError(setting, path, f"cannot be read: {(reason or str(error)).lower()}") from error
    if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
        raise UserError(setting, path, f"others may read it (mode {stat.S_IMODE(mode):o}): chmod 600 {path}")
    try:
        found = yaml.safe_load(text) or {}
    except yaml.YAMLError:
        found = None  # the parser's words would quote the file
    known = ", ".join(FIELDS)
    if not isinstance(found, dict) or not set(found) <= set(FIELDS):
        raise UserError(setting, path, f"a YAML file with some of {known}")
    if not all(isinstance(value, str) for value in found.values()):
        raise UserError(setting, path, f"texts for {known}; put a key or a password of digits into quotes")
    base = path.absolute().parent
    return {name: str(base / value) if name.endswith("_file") else value for name, value in found.items()}
