"""Sealed answers: what a recording hides, encrypted, with a commitment that shows any later change.

The secret is encrypted by Fernet (AES-128 in CBC mode with an HMAC). The SHA-256 of a random number and the secret is
public: it is compared when the seal is opened. The secret holds the recording's hash, so that nobody can exchange the
recording under its seal.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
import secrets
from pathlib import Path
from typing import Any

from cryptography.fernet import Fernet, InvalidToken
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CBC
from cryptography.hazmat.primitives.padding import PKCS7

from dtbacklash.errors import UserError
from dtbacklash.files import reason, write_once
from dtbacklash.prove.secret import Secret

RECORDING, PUBLIC, SEALED = "recording.csv.gz", "public.json", "sealed.json"
FORMAT = "dtbacklash sealed secret 1"
#: the sealed text is padded to a multiple of this many bytes, so that its length does not tell how much is hidden
PADDING = 8192


def key_path(folder: Path) -> Path:
    """The default place of the key of a folder of concealed recordings: beside the folder."""
    return folder.with_name(folder.name + ".key")


def read_key(path: Path) -> bytes:
    """Read a key; raises UserError: it cannot be read, or is no key."""
    try:
        key = path.read_bytes().strip()
    except OSError as error:
        raise UserError("key", path, f"cannot be read: {reason(error)}") from error
    _cipher(key, path)
    return key


def read_or_make_key(path: Path) -> bytes:
    """The key in ``path``; if there is no such file, a new key is written there, readable by its owner only.

    Raises UserError: it cannot be written, or is no key.
    """
    if not path.exists():
        write_once(path, Fernet.generate_key() + b"\n", "key")
    return read_key(path)


def _cipher(key: bytes, path: Path) -> Fernet:
    try:
        return Fernet(key)
    except ValueError:
        raise UserError("key", path, "holds no key; it is the file that `dtb conceal` has written") from None


def check_apart(key_file: Path, folder: Path, what: str) -> None:
    """Refuse a key that lies in the folder that is handed out. what : is in it.

    Raises UserError.
    """
    if folder.resolve() in key_file.resolve().parents:
        raise UserError("key", key_file, f"a file outside {folder}: who gets the {what} must not get the key")


def seal(secret: Secret, recording: bytes, key: bytes) -> dict[str, str]:
    """Seal a secret with the recording that it belongs to; returns the content of ``sealed.json``."""
    return seal_text(secret.to_json(), recording, key, secrets.token_hex(32))


def seal_text(text: str, content: bytes, key: bytes, nonce: str | None = None) -> dict[str, str]:
    """Seal any text with the bytes that it belongs to.

    nonce : a random number. None: it follows from text and key, and so does the whole seal, to the last bit.
    """
    known = {"secret": text, "recording_sha256": hashlib.sha256(content).hexdigest()}
    fixed = keyed_hash(key, json.dumps(known))
    plain = json.dumps({"nonce": nonce or fixed.hex(), **known}).encode()
    padded = plain.ljust(-(-len(plain) // PADDING) * PADDING)
    token = Fernet(key).encrypt(padded) if nonce else _fernet(padded, key, fixed[:16])
    return {"format": FORMAT, "sha256": commitment(nonce or fixed.hex(), text), "token": token.decode()}


def keyed_hash(key: bytes, content: str | bytes) -> bytes:
    """HMAC-SHA-256 of a text (as UTF-8) or of bytes: it tells nothing without the key (RFC 2104)."""
    return hmac.digest(key, content.encode() if isinstance(content, str) else content, "sha256")


def _fernet(plain: bytes, key: bytes, start: bytes) -> bytes:
    """A token by the specification of Fernet, of time 0 and with a given start of its chain of blocks (16 bytes)."""
    both = base64.urlsafe_b64decode(key)
    padder = PKCS7(128).padder()
    cipher = Cipher(AES(both[16:]), CBC(start)).encryptor()
    blocks = cipher.update(padder.update(plain) + padder.finalize()) + cipher.finalize()
    signed = b"\x80" + bytes(8) + start + blocks
    return base64.urlsafe_b64encode(signed + keyed_hash(both[:16], signed))


def commitment(nonce: str, text: str) -> str:
    """SHA-256 of nonce and secret, hexadecimal."""
    return hashlib.sha256((nonce + text).encode()).hexdigest()


def open_seal(case: Path | str, key_file: Path | str) -> Secret:
    """Open the seal of a case. Only scoring may call this, when all diagnoses are written.

    case : the folder of one concealed recording. key_file : the key that it was sealed with.

    Raises UserError: no such case or key, a wrong key, a seal or a recording that has been changed.
    """
    case = Path(case)
    try:
        recording = (case / RECORDING).read_bytes()
    except OSError as error:
        raise UserError("case", case, f"{RECORDING} cannot be read: {reason(error)}") from error
    return Secret.from_json(open_text(case, Path(key_file), recording, RECORDING))


def open_text(case: Path, key_file: Path, content: bytes, name: str) -> str:
    """The text that is sealed in a case's ``sealed.json`` with the bytes ``content`` of its file ``name``.

    Raises UserError: no key, a wrong one, a seal or a file that has been changed.
    """
    cipher = _cipher(read_key(key_file), key_file)
    sealed = read_seal(case)
    try:
        known = json.loads(cipher.decrypt(sealed["token"].encode()))
    except InvalidToken:
        raise UserError("key", key_file, f"does not open {case / SEALED}: a wrong key, or a changed seal") from None
    if commitment(known["nonce"], known["secret"]) != sealed["sha256"]:
        raise UserError("case", case, f"{SEALED} has been changed: the secret does not match its commitment")
    if hashlib.sha256(content).hexdigest() != known["recording_sha256"]:
        raise UserError("case", case, f"{name} is not the one that was sealed")
    return str(known["secret"])


def read_seal(case: Path) -> dict[str, Any]:
    """The content of a case's ``sealed.json``, still encrypted; raises UserError: it cannot be read, or is no seal."""
    try:
        sealed = json.loads((case / SEALED).read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError("case", case, f"{SEALED} cannot be read: {reason(error)}") from error
    except ValueError:
        sealed = None
    form = isinstance(sealed, dict) and sealed.get("format") == FORMAT
    if not form or not all(isinstance(sealed.get(name), str) for name in ("sha256", "token")):
        raise UserError("case", case, f"{SEALED} is no seal of `dtb conceal`, or has been changed")
    return dict(sealed)
