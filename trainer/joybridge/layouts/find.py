"""From the name of a layout to the layout: those of Joybridge, and those of other installed packages.

Another package offers layouts as entry points of the group `joybridge.layouts`:

    [project.entry-points."joybridge.layouts"]
    compass = "my_package:compass"

Then `compass` and `compass-SETTING` are layouts, and `my_package.compass(device, setting)` makes them: a `Maker`. The
function of a module is one without any package, as `my_module:compass` and `my_module:compass-SETTING`.
"""

from collections.abc import Callable, Mapping
from functools import cache

from joybridge.config.errors import ConfigError, DeviceError, SettingError
from joybridge.config.own_names import load_own
from joybridge.contract.text import printable
from joybridge.layouts.bucket import bucket
from joybridge.layouts.check import check_layouts
from joybridge.layouts.continuous import beta, gsde, squashed
from joybridge.layouts.hybrid import hybrid
from joybridge.layouts.joint import joint
from joybridge.layouts.layout import Layout
from joybridge.layouts.map import point_map
from joybridge.layouts.multiagent import multiagent
from joybridge.layouts.ordinal import ordinal
from joybridge.layouts.threshold import threshold
from joybridge.plugins import find
from joybridge.v1 import bridge_pb2 as pb

GROUP = "joybridge.layouts"  # of entry points

# Makes the layout of a device, or those of several policies by the names of their parts of the device. The second
# argument is the setting: what follows the first dash of the layout's name. Raises SettingError and DeviceError.
Maker = Callable[[pb.Device, str], Layout | Mapping[str, Layout]]

KINDS: dict[str, Maker] = {
    "hybrid": hybrid,
    "multiagent": multiagent,
    "bucket": bucket,
    "threshold": threshold,
    "joint": joint,
    "ordinal": ordinal,
    "beta": beta,
    "squashed": squashed,
    "gsde": gsde,
    "map": point_map,
}
FORMS = (
    "hybrid",
    "multiagent",
    "bucket-N",
    "bucket-N-mu",
    "threshold-T",
    "joint-N",
    "joint-N-mu",
    "ordinal-N",
    "ordinal-N-mu",
    "beta",
    "squashed",
    "gsde-N",
    "map-WxH",
    "map-WxH-relative",
)


def find_layouts(name: str, device: pb.Device) -> dict[str, Layout]:
    """Return the layouts of one name without commas for a device, checked.

    The keys name the part of the device that each of several policies holds; a single policy's is "". Raises
    ConfigError.
    """
    kind, _, setting = name.partition("-")
    maker: Maker = load_own("layout", kind) if ":" in kind else KINDS.get(kind) or _installed(kind, name)
    try:
        made = maker(device, setting)
        layouts = {"": made} if isinstance(made, Layout) else dict(made)
        check_layouts(list(layouts.values()), device)
    except SettingError as error:
        raise ConfigError(f"layout: unknown layout {name!r}, {error}") from None
    except DeviceError as error:
        raise ConfigError(f"layout: {name!r} cannot express this device: {error}") from None
    except (ConfigError, KeyboardInterrupt):
        raise
    except BaseException as error:  # what another package raises, exit() included
        raise ConfigError(
            f"layout: {name!r} cannot be made: {type(error).__name__}: {printable(str(error))}"
        ) from error
    return layouts


@cache  # looking through all installed packages takes ten milliseconds
def _installed(kind: str, name: str) -> Maker:
    """Return what makes the layouts of one kind in another package. Raises ConfigError."""
    offered = find(GROUP)
    found = [point for point in offered if point.name == kind]
    if not found:
        raise ConfigError(
            f"layout: unknown layout {name!r}, expected "
            f"{', '.join([*FORMS, *sorted(point.name for point in offered), 'MODULE:NAME-SETTING'])}"
        )
    if len(found) > 1:
        raise ConfigError(f"layout: {kind!r} is offered by {' and '.join(e.value for e in found)}; uninstall one")
    (entry,) = found
    try:
        maker: Maker = entry.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        text = f"{type(error).__name__}: {printable(str(error))}"
        raise ConfigError(f"layout: {kind!r} cannot be loaded from {entry.value!r}: {text}") from error
    return maker
