"""Which runs this user has written on this machine: those whose notes are signed with a key that never leaves it.

A run is a folder that anybody may have made, so what it names is started, imported or called only if its signature is
right. The key is made by the first signature, in the user's state folder, and is readable by that user alone.
"""

import hashlib
import hmac
import os
import secrets
import stat
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from joybridge.config.errors import StorageError, UntrustedRunError
from joybridge.contract.files import read_file
from joybridge.contract.text import printable

KEY_BYTES = 32


def key_file() -> Path:
    """Return where the key is: $XDG_STATE_HOME/joybridge/key, by default in ~/.local/state. Raises StorageError."""
    base = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        return (base if base.is_absolute() else Path.home() / ".local" / "state") / "joybridge" / "key"
    except RuntimeError as error:
        raise StorageError(f"there is no home folder for the key of runs ({error}); set XDG_STATE_HOME") from error


def sign(content: bytes) -> str:
    """Return the signature of what this user writes; the first one makes the key. Raises StorageError."""
    return _signature(_read_key() or _make_key(), content)


def is_ours(content: bytes, signature: str) -> bool:
    """Return whether this user has signed the content on this machine. Raises StorageError for a key of others."""
    key = _read_key()
    return key is not None and hmac.compare_digest(
        _signature(key, content).encode(), signature.encode(errors="replace")
    )


def sign_or_say(content: bytes, say: Callable[[str], None]) -> str:
    """Return the signature of what this user writes; "" if there can be none, and say what this means."""
    try:
        return sign(content)
    except StorageError as error:
        say(f"{error}; the run plays with --trust-run only, because nothing shows that it is yours")
        return ""


def untrusted(run: Path, wishes: Sequence[str]) -> UntrustedRunError:
    """Return the error of a run that is not ours. wishes: what it would have done, as in "start my_game:MyGame"."""
    return UntrustedRunError(
        printable(
            f"{run} wants to {', '.join(wishes)}, and you have not trained it on this machine from this folder, "
            "so nothing was done; if you trust it, repeat the command with --trust-run"
        )
    )


def _signature(key: bytes, content: bytes) -> str:
    return hmac.new(key, content, hashlib.sha256).hexdigest()


def _read_key() -> bytes | None:
    """Return the key; None if there is none yet. Raises StorageError if somebody else may know or have made it."""
    path = key_file()
    try:
        status = os.lstat(path)
        own = os.name == "nt" or (status.st_uid == os.geteuid() and not status.st_mode & 0o077)
        if not own or not stat.S_ISREG(status.st_mode):
            raise StorageError(f"{path} is not a file of this user alone; delete it, and a new key is made")
        key = read_file(path, KEY_BYTES)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StorageError(
            f"cannot read {path}: {error.strerror or error}; delete it, and a new key is made"
        ) from error
    if len(key) != KEY_BYTES:
        raise StorageError(f"{path} has {len(key)} bytes, expected {KEY_BYTES}; delete it, and a new key is made")
    return key


def _make_key() -> bytes:
    """Make the key, unless another process has just done so, and return it. Raises StorageError."""
    path = key_file()
    new = path.with_name(f".key-{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with os.fdopen(os.open(new, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as file:
            file.write(secrets.token_bytes(KEY_BYTES))
        with suppress(FileExistsError):
            os.link(new, path)  # unlike a renaming, it replaces no key
    except OSError as error:
        raise StorageError(f"cannot write {error.filename or path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            new.unlink(missing_ok=True)
    key = _read_key()
    if key is None:
        raise StorageError(f"cannot write {path}: it is gone again")
    return key
