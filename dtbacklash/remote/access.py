"""Users, passwords, keys and access rules for an MQTT broker, as files for Mosquitto."""

from __future__ import annotations

import secrets
import shutil
import subprocess
from pathlib import Path

import yaml

from dtbacklash.errors import Failure, UserError
from dtbacklash.files import written
from dtbacklash.remote.credentials import STATUS, Key
from dtbacklash.remote.protocol import REQUESTS, ROOT, STATUSES, answer_topic, check_name, request_topic

TWIN, MONITOR = "twin", "monitor"
ACL, PASSWORDS, CONF = "acl", "passwords", "mosquitto.conf"
#: where Debian has the broker, which is not in everybody's path
ALSO = ("/usr/sbin", "/usr/local/sbin", "/opt/homebrew/sbin")
INSTALL = "is not installed; Debian and Ubuntu: apt install mosquitto"


def program(name: str) -> str:
    """The path of one of Mosquitto's programs; raises UserError where it is not installed."""
    found = shutil.which(name) or next((f"{place}/{name}" for place in ALSO if Path(place, name).exists()), None)
    if found is None:
        raise UserError("broker", name, INSTALL)
    return found


def rules(machines: list[str]) -> str:
    """The access rules: what is not allowed here is forbidden."""
    lines = [
        "# Mosquitto's acl_file: the twin hears all machines and answers them; a machine has its own topics alone;",
        "# the monitor reads how the twins are.",
        f"user {TWIN}", f"topic read {REQUESTS}", f"topic write {ROOT}/machine/+/answer",
        f"topic readwrite {STATUSES}", "",
        f"user {MONITOR}", f"topic read {STATUSES}", "",
    ]  # fmt: skip
    for machine in machines:
        lines += [f"user {machine}", f"topic write {request_topic(machine)}", f"topic read {answer_topic(machine)}", ""]
    return "\n".join(lines)


def write(folder: Path, machines: list[str]) -> list[tuple[Path, str]]:
    """Make a folder with all of it; its files and what they are.

    Raises
    ------
    UserError : names that are none, or taken; the folder is there; Mosquitto's programs are not installed.
    """
    if folder.exists():
        raise UserError("out", folder, "is there; keys and passwords are not replaced: give a new folder")
    for machine in machines:
        check_name("machines", machine)
        if machine in (TWIN, MONITOR):
            raise UserError("machines", machine, f"another name; {TWIN} and {MONITOR} have users of their own")
    if not machines or len(set(machines)) < len(machines):
        raise UserError("machines", ",".join(machines), "names, each once")
    hasher = program("mosquitto_passwd")
    key = Key.drawn()
    keys = {TWIN: key, MONITOR: key.of_machine(STATUS), **{name: key.of_machine(name) for name in machines}}
    users = {name: secrets.token_hex(24) for name in keys}
    with written(folder, "out") as scratch:
        scratch.mkdir(mode=0o700)
        for name, password in users.items():
            content = {"user": name, "password": password, "key": keys[name].text()}
            _secret(scratch / f"{name}.yaml", f"# Of {name} alone.\n" + yaml.safe_dump(content, sort_keys=False))
        _secret(scratch / PASSWORDS, "".join(f"{name}:{password}\n" for name, password in users.items()))
        _hash(hasher, scratch / PASSWORDS)
        (scratch / ACL).write_text(rules(machines), encoding="utf-8")
        (scratch / CONF).write_text(configuration(folder.absolute()), encoding="utf-8")
    said = {
        f"{TWIN}.yaml": "for dtb twin serve credentials=",
        f"{MONITOR}.yaml": "for dtb twin status credentials=",
        **{f"{name}.yaml": "for dtb run twin=remote twin.credentials=" for name in machines},
        PASSWORDS: "password_file of Mosquitto, hashed",
        ACL: "acl_file of Mosquitto",
        CONF: "a configuration of Mosquitto with both, on 127.0.0.1",
    }
    return [(folder / name, what) for name, what in said.items()]


def configuration(folder: Path, port: int = 1883, user: str | None = None) -> str:
    """A configuration of Mosquitto that lets in the users of a folder of :func:`write`, from this machine."""
    as_user = [f"user {user}"] if user else []
    return "\n".join([
        "# Mosquitto 2: this machine only; nobody without a password; each user within its access rules",
        f"listener {port} 127.0.0.1", "allow_anonymous false", f"password_file {folder / PASSWORDS}",
        f"acl_file {folder / ACL}", *as_user, "persistence false", "set_tcp_nodelay true", "max_packet_size 5000000",
        "max_queued_messages 100", "max_queued_bytes 20000000", "log_type error", "log_type warning",
        "log_type notice", "log_dest stderr", "connection_messages true", "",
    ])  # fmt: skip


def _secret(path: Path, text: str) -> None:
    path.touch(mode=0o600)
    path.write_text(text, encoding="utf-8")


def _hash(hasher: str, passwords: Path) -> None:
    """Replace the passwords by their hashes; not as an argument, which other processes could read."""
    done = subprocess.run([hasher, "-U", str(passwords)], capture_output=True, text=True, check=False, timeout=120)
    if done.returncode:
        raise Failure("out", passwords.name, f"mosquitto_passwd failed: {done.stderr.strip()[:200]}")
    passwords.chmod(0o600)
