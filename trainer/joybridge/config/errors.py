"""The trainer's exceptions, all of them JoybridgeErrors; those of the wire are in `client/errors.py`.

JoybridgeError
├── ConfigError        a configuration that cannot be used
│   ├── SettingError   a layout that does not know its setting
│   └── DeviceError    a layout that cannot express a device
├── UntrustedRunError  a run of somebody else that names programs or addresses
├── CheckpointError    a checkpoint that is missing or cannot be read
├── StorageError       a file or folder that cannot be written
├── RunLockedError     a run that another process is training
├── DivergedError      an update has made a network useless
└── ExportError        an exported policy that does not play as the trainer does
"""

from joybridge.contract.errors import JoybridgeError


class ConfigError(JoybridgeError, ValueError):
    """A setting that cannot be used; the text names the key, the value and what was expected."""


class SettingError(ConfigError):
    """A layout does not know its setting, the part of its name after the first dash. The text: "expected ..."."""


class DeviceError(ConfigError):
    """A layout cannot express a device. The text says why, and what to use instead."""


class UntrustedRunError(JoybridgeError):
    """A run that this user has not written wants to start a program or to call an address; the text names them."""

    exit_status = 2


class CheckpointError(JoybridgeError):
    """A checkpoint that is missing or cannot be read; the text names the file and what to do."""


class StorageError(JoybridgeError):
    """A file or folder that cannot be written; the text names it and the reason."""


class RunLockedError(JoybridgeError):
    """A run that another process is training; the text names the process."""


class DivergedError(JoybridgeError):
    """An update has made a network useless; the run keeps its state from before."""


class ExportError(JoybridgeError):
    """An exported policy that does not play as the trainer does; nothing is written."""


def no_export(file: object, error: ModuleNotFoundError) -> ConfigError:
    """Return the error of an exported policy where the extra that plays it is not installed."""
    return ConfigError(f"{file}: needs the module {error.name}; install it with `pip install 'joybridge[export]'`")


def no_picture(game: str) -> ConfigError:
    """Return the error of a game that cannot be drawn."""
    return ConfigError(
        f"{game} cannot be drawn: its spec has no picture; if the game is yours, give it `draw`, and "
        "spec(…, picture=(WIDTH, HEIGHT)), the size of what it returns"
    )
