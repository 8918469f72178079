"""Action layouts: how a policy's actions map to the device of a game.

The paper compares such mappings. Each works on the device of any spec, knows no game, and is pure:

    hybrid        every axis a Gaussian, every branch categorical, one joint log-probability
    bucket-N      every axis a branch of N evenly spaced values; all buttons share one branch with "nothing"
    bucket-N-mu   the same, with values that are dense in the middle of each axis
    ordinal-N     as bucket-N, with an ordinal distribution over the values of each axis
    joint-N       one branch: all combinations of N values per axis and of the choices of all branches
    beta          as hybrid, with a beta distribution for every axis
    squashed      as hybrid, with a Gaussian that tanh squashes for every axis
    gsde-N        as hybrid, with noise that depends on the state and is kept for N decisions
    map-WxH       two axes one branch: a place in an image that the policy sees
    threshold-T   every axis and every button a Gaussian; a button is pressed by a threshold
    multiagent    two policies: one holds the axes, one the buttons

A button is a branch of two choices. `mixed.py` gives single axes, branches and behaviors a layout of their own,
and `find.py` takes layouts from other packages. A layout is a `Layout`: parts that say what each continuous action
and each branch of a policy does. docs/layouts.md shows how to write one.
"""

from joybridge.config.errors import DeviceError, SettingError
from joybridge.layouts.layout import CLIP, ActionSpace, Layout
from joybridge.layouts.mixed import make_layouts
from joybridge.layouts.roles import Role, list_roles, make_acts
from joybridge.layouts.targets import AxisRange, AxisTable, JointTable, Map, Split, Threshold

__all__ = [
    "CLIP", "ActionSpace", "AxisRange", "AxisTable", "DeviceError", "JointTable", "Layout", "Map", "Role",
    "SettingError", "Split", "Threshold", "list_roles", "make_acts", "make_layouts",
]  # fmt: skip
