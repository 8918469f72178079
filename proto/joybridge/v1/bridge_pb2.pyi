from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Color(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    COLOR_UNSPECIFIED: _ClassVar[Color]
    COLOR_GRAY: _ClassVar[Color]
    COLOR_RGB: _ClassVar[Color]

class AxisKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    AXIS_KIND_UNSPECIFIED: _ClassVar[AxisKind]
    AXIS_KIND_POSITION: _ClassVar[AxisKind]
    AXIS_KIND_VELOCITY: _ClassVar[AxisKind]
    AXIS_KIND_ANGLE: _ClassVar[AxisKind]

class Way(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    WAY_UNSPECIFIED: _ClassVar[Way]
    WAY_RIGHT: _ClassVar[Way]
    WAY_LEFT: _ClassVar[Way]
    WAY_UP: _ClassVar[Way]
    WAY_DOWN: _ClassVar[Way]

class Dtype(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DTYPE_UNSPECIFIED: _ClassVar[Dtype]
    DTYPE_FLOAT32: _ClassVar[Dtype]
    DTYPE_INT32: _ClassVar[Dtype]
    DTYPE_UINT8: _ClassVar[Dtype]
    DTYPE_BOOL: _ClassVar[Dtype]

class Reason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REASON_UNSPECIFIED: _ClassVar[Reason]
    REASON_UNKNOWN_GAME: _ClassVar[Reason]
    REASON_MALFORMED_MESSAGE: _ClassVar[Reason]
    REASON_UNKNOWN_REQUEST: _ClassVar[Reason]
    REASON_UNKNOWN_OPTION: _ClassVar[Reason]
    REASON_UNKNOWN_CHOICE: _ClassVar[Reason]
    REASON_UNKNOWN_PARAMETER: _ClassVar[Reason]
    REASON_PARAMETER_OUT_OF_RANGE: _ClassVar[Reason]
    REASON_NO_ARENAS: _ClassVar[Reason]
    REASON_WRONG_SNAPSHOT: _ClassVar[Reason]
    REASON_WRONG_BEHAVIORS: _ClassVar[Reason]
    REASON_WRONG_TENSOR: _ClassVar[Reason]
    REASON_NOT_FINITE: _ClassVar[Reason]
    REASON_ACTION_OUT_OF_RANGE: _ClassVar[Reason]
    REASON_ACTION_MASKED: _ClassVar[Reason]
    REASON_WRONG_DRAW: _ClassVar[Reason]
    REASON_OLD_SERVER: _ClassVar[Reason]
    REASON_WRONG_ORDER: _ClassVar[Reason]
    REASON_NO_SNAPSHOTS: _ClassVar[Reason]
    REASON_NO_PICTURES: _ClassVar[Reason]
    REASON_TOO_MANY_ARENAS: _ClassVar[Reason]
    REASON_TOO_MANY_SESSIONS: _ClassVar[Reason]
    REASON_MESSAGE_TOO_LARGE: _ClassVar[Reason]
    REASON_GAME_FAILED: _ClassVar[Reason]
    REASON_GAME_TOO_SLOW: _ClassVar[Reason]
    REASON_NO_START: _ClassVar[Reason]
    REASON_IDLE: _ClassVar[Reason]
    REASON_NO_TOKEN: _ClassVar[Reason]
    REASON_SHUTTING_DOWN: _ClassVar[Reason]
    REASON_WRONG_DISTRIBUTION: _ClassVar[Reason]
    REASON_NO_DISTRIBUTIONS: _ClassVar[Reason]
COLOR_UNSPECIFIED: Color
COLOR_GRAY: Color
COLOR_RGB: Color
AXIS_KIND_UNSPECIFIED: AxisKind
AXIS_KIND_POSITION: AxisKind
AXIS_KIND_VELOCITY: AxisKind
AXIS_KIND_ANGLE: AxisKind
WAY_UNSPECIFIED: Way
WAY_RIGHT: Way
WAY_LEFT: Way
WAY_UP: Way
WAY_DOWN: Way
DTYPE_UNSPECIFIED: Dtype
DTYPE_FLOAT32: Dtype
DTYPE_INT32: Dtype
DTYPE_UINT8: Dtype
DTYPE_BOOL: Dtype
REASON_UNSPECIFIED: Reason
REASON_UNKNOWN_GAME: Reason
REASON_MALFORMED_MESSAGE: Reason
REASON_UNKNOWN_REQUEST: Reason
REASON_UNKNOWN_OPTION: Reason
REASON_UNKNOWN_CHOICE: Reason
REASON_UNKNOWN_PARAMETER: Reason
REASON_PARAMETER_OUT_OF_RANGE: Reason
REASON_NO_ARENAS: Reason
REASON_WRONG_SNAPSHOT: Reason
REASON_WRONG_BEHAVIORS: Reason
REASON_WRONG_TENSOR: Reason
REASON_NOT_FINITE: Reason
REASON_ACTION_OUT_OF_RANGE: Reason
REASON_ACTION_MASKED: Reason
REASON_WRONG_DRAW: Reason
REASON_OLD_SERVER: Reason
REASON_WRONG_ORDER: Reason
REASON_NO_SNAPSHOTS: Reason
REASON_NO_PICTURES: Reason
REASON_TOO_MANY_ARENAS: Reason
REASON_TOO_MANY_SESSIONS: Reason
REASON_MESSAGE_TOO_LARGE: Reason
REASON_GAME_FAILED: Reason
REASON_GAME_TOO_SLOW: Reason
REASON_NO_START: Reason
REASON_IDLE: Reason
REASON_NO_TOKEN: Reason
REASON_SHUTTING_DOWN: Reason
REASON_WRONG_DISTRIBUTION: Reason
REASON_NO_DISTRIBUTIONS: Reason

class Version(_message.Message):
    __slots__ = ("product", "revision")
    PRODUCT_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    product: str
    revision: int
    def __init__(self, product: _Optional[str] = ..., revision: _Optional[int] = ...) -> None: ...

class ListGamesRequest(_message.Message):
    __slots__ = ("version",)
    VERSION_FIELD_NUMBER: _ClassVar[int]
    version: Version
    def __init__(self, version: _Optional[_Union[Version, _Mapping]] = ...) -> None: ...

class ListGamesResponse(_message.Message):
    __slots__ = ("games", "version")
    GAMES_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    games: _containers.RepeatedCompositeFieldContainer[GameSummary]
    version: Version
    def __init__(self, games: _Optional[_Iterable[_Union[GameSummary, _Mapping]]] = ..., version: _Optional[_Union[Version, _Mapping]] = ...) -> None: ...

class GameSummary(_message.Message):
    __slots__ = ("name", "description")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ...) -> None: ...

class DescribeGameRequest(_message.Message):
    __slots__ = ("game", "options", "version")
    class OptionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    GAME_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    game: str
    options: _containers.ScalarMap[str, str]
    version: Version
    def __init__(self, game: _Optional[str] = ..., options: _Optional[_Mapping[str, str]] = ..., version: _Optional[_Union[Version, _Mapping]] = ...) -> None: ...

class DescribeGameResponse(_message.Message):
    __slots__ = ("spec", "version")
    SPEC_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    spec: GameSpec
    version: Version
    def __init__(self, spec: _Optional[_Union[GameSpec, _Mapping]] = ..., version: _Optional[_Union[Version, _Mapping]] = ...) -> None: ...

class GameSpec(_message.Message):
    __slots__ = ("name", "description", "options", "parameters", "behaviors", "decision_interval", "tick_seconds", "max_episode_decisions", "max_arenas", "picture", "snapshot_bytes_per_arena", "parameters_per_episode", "version")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    BEHAVIORS_FIELD_NUMBER: _ClassVar[int]
    DECISION_INTERVAL_FIELD_NUMBER: _ClassVar[int]
    TICK_SECONDS_FIELD_NUMBER: _ClassVar[int]
    MAX_EPISODE_DECISIONS_FIELD_NUMBER: _ClassVar[int]
    MAX_ARENAS_FIELD_NUMBER: _ClassVar[int]
    PICTURE_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_BYTES_PER_ARENA_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_PER_EPISODE_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    options: _containers.RepeatedCompositeFieldContainer[Option]
    parameters: _containers.RepeatedCompositeFieldContainer[Parameter]
    behaviors: _containers.RepeatedCompositeFieldContainer[Behavior]
    decision_interval: int
    tick_seconds: float
    max_episode_decisions: int
    max_arenas: int
    picture: PictureSize
    snapshot_bytes_per_arena: int
    parameters_per_episode: bool
    version: str
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., options: _Optional[_Iterable[_Union[Option, _Mapping]]] = ..., parameters: _Optional[_Iterable[_Union[Parameter, _Mapping]]] = ..., behaviors: _Optional[_Iterable[_Union[Behavior, _Mapping]]] = ..., decision_interval: _Optional[int] = ..., tick_seconds: _Optional[float] = ..., max_episode_decisions: _Optional[int] = ..., max_arenas: _Optional[int] = ..., picture: _Optional[_Union[PictureSize, _Mapping]] = ..., snapshot_bytes_per_arena: _Optional[int] = ..., parameters_per_episode: bool = ..., version: _Optional[str] = ...) -> None: ...

class Option(_message.Message):
    __slots__ = ("name", "description", "choices", "default_choice")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    CHOICES_FIELD_NUMBER: _ClassVar[int]
    DEFAULT_CHOICE_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    choices: _containers.RepeatedScalarFieldContainer[str]
    default_choice: str
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., choices: _Optional[_Iterable[str]] = ..., default_choice: _Optional[str] = ...) -> None: ...

class Parameter(_message.Message):
    __slots__ = ("name", "description", "low", "high", "default_value")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    LOW_FIELD_NUMBER: _ClassVar[int]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    DEFAULT_VALUE_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    low: float
    high: float
    default_value: float
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., low: _Optional[float] = ..., high: _Optional[float] = ..., default_value: _Optional[float] = ...) -> None: ...

class Behavior(_message.Message):
    __slots__ = ("name", "description", "agents_per_arena", "sensors", "device", "channels", "metrics", "scripts")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    AGENTS_PER_ARENA_FIELD_NUMBER: _ClassVar[int]
    SENSORS_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    SCRIPTS_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    agents_per_arena: int
    sensors: _containers.RepeatedCompositeFieldContainer[Sensor]
    device: Device
    channels: _containers.RepeatedCompositeFieldContainer[RewardChannel]
    metrics: _containers.RepeatedCompositeFieldContainer[Metric]
    scripts: _containers.RepeatedCompositeFieldContainer[Script]
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., agents_per_arena: _Optional[int] = ..., sensors: _Optional[_Iterable[_Union[Sensor, _Mapping]]] = ..., device: _Optional[_Union[Device, _Mapping]] = ..., channels: _Optional[_Iterable[_Union[RewardChannel, _Mapping]]] = ..., metrics: _Optional[_Iterable[_Union[Metric, _Mapping]]] = ..., scripts: _Optional[_Iterable[_Union[Script, _Mapping]]] = ...) -> None: ...

class Script(_message.Message):
    __slots__ = ("name", "description")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ...) -> None: ...

class Sensor(_message.Message):
    __slots__ = ("name", "description", "dtype", "shape", "elements", "low", "high", "image")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    DTYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    ELEMENTS_FIELD_NUMBER: _ClassVar[int]
    LOW_FIELD_NUMBER: _ClassVar[int]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    dtype: Dtype
    shape: _containers.RepeatedScalarFieldContainer[int]
    elements: _containers.RepeatedScalarFieldContainer[str]
    low: _containers.RepeatedScalarFieldContainer[float]
    high: _containers.RepeatedScalarFieldContainer[float]
    image: Image
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., dtype: _Optional[_Union[Dtype, str]] = ..., shape: _Optional[_Iterable[int]] = ..., elements: _Optional[_Iterable[str]] = ..., low: _Optional[_Iterable[float]] = ..., high: _Optional[_Iterable[float]] = ..., image: _Optional[_Union[Image, _Mapping]] = ...) -> None: ...

class Image(_message.Message):
    __slots__ = ("color", "centered")
    COLOR_FIELD_NUMBER: _ClassVar[int]
    CENTERED_FIELD_NUMBER: _ClassVar[int]
    color: Color
    centered: bool
    def __init__(self, color: _Optional[_Union[Color, str]] = ..., centered: bool = ...) -> None: ...

class Device(_message.Message):
    __slots__ = ("axes", "branches")
    AXES_FIELD_NUMBER: _ClassVar[int]
    BRANCHES_FIELD_NUMBER: _ClassVar[int]
    axes: _containers.RepeatedCompositeFieldContainer[Axis]
    branches: _containers.RepeatedCompositeFieldContainer[Branch]
    def __init__(self, axes: _Optional[_Iterable[_Union[Axis, _Mapping]]] = ..., branches: _Optional[_Iterable[_Union[Branch, _Mapping]]] = ...) -> None: ...

class Axis(_message.Message):
    __slots__ = ("name", "description", "low", "high", "only_with", "kind", "way")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    LOW_FIELD_NUMBER: _ClassVar[int]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    ONLY_WITH_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    WAY_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    low: float
    high: float
    only_with: Condition
    kind: AxisKind
    way: Way
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., low: _Optional[float] = ..., high: _Optional[float] = ..., only_with: _Optional[_Union[Condition, _Mapping]] = ..., kind: _Optional[_Union[AxisKind, str]] = ..., way: _Optional[_Union[Way, str]] = ...) -> None: ...

class Condition(_message.Message):
    __slots__ = ("branch", "choice")
    BRANCH_FIELD_NUMBER: _ClassVar[int]
    CHOICE_FIELD_NUMBER: _ClassVar[int]
    branch: str
    choice: str
    def __init__(self, branch: _Optional[str] = ..., choice: _Optional[str] = ...) -> None: ...

class Branch(_message.Message):
    __slots__ = ("name", "description", "choices", "keys")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    CHOICES_FIELD_NUMBER: _ClassVar[int]
    KEYS_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    choices: _containers.RepeatedScalarFieldContainer[str]
    keys: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., choices: _Optional[_Iterable[str]] = ..., keys: _Optional[_Iterable[str]] = ...) -> None: ...

class RewardChannel(_message.Message):
    __slots__ = ("name", "description", "default_weight")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    DEFAULT_WEIGHT_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    default_weight: float
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ..., default_weight: _Optional[float] = ...) -> None: ...

class Metric(_message.Message):
    __slots__ = ("name", "description")
    NAME_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    description: str
    def __init__(self, name: _Optional[str] = ..., description: _Optional[str] = ...) -> None: ...

class PictureSize(_message.Message):
    __slots__ = ("width", "height")
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    width: int
    height: int
    def __init__(self, width: _Optional[int] = ..., height: _Optional[int] = ...) -> None: ...

class PlayRequest(_message.Message):
    __slots__ = ("start", "act", "reset", "save")
    START_FIELD_NUMBER: _ClassVar[int]
    ACT_FIELD_NUMBER: _ClassVar[int]
    RESET_FIELD_NUMBER: _ClassVar[int]
    SAVE_FIELD_NUMBER: _ClassVar[int]
    start: Start
    act: Act
    reset: Reset
    save: Save
    def __init__(self, start: _Optional[_Union[Start, _Mapping]] = ..., act: _Optional[_Union[Act, _Mapping]] = ..., reset: _Optional[_Union[Reset, _Mapping]] = ..., save: _Optional[_Union[Save, _Mapping]] = ...) -> None: ...

class PlayResponse(_message.Message):
    __slots__ = ("started", "step", "snapshot")
    STARTED_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_FIELD_NUMBER: _ClassVar[int]
    started: Started
    step: Step
    snapshot: Snapshot
    def __init__(self, started: _Optional[_Union[Started, _Mapping]] = ..., step: _Optional[_Union[Step, _Mapping]] = ..., snapshot: _Optional[_Union[Snapshot, _Mapping]] = ...) -> None: ...

class Start(_message.Message):
    __slots__ = ("game", "options", "parameters", "arenas", "seed", "first_arena", "snapshot", "version", "local_transport", "distributions")
    class OptionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    class ParametersEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class DistributionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Distribution
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Distribution, _Mapping]] = ...) -> None: ...
    GAME_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    ARENAS_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    FIRST_ARENA_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    LOCAL_TRANSPORT_FIELD_NUMBER: _ClassVar[int]
    DISTRIBUTIONS_FIELD_NUMBER: _ClassVar[int]
    game: str
    options: _containers.ScalarMap[str, str]
    parameters: _containers.ScalarMap[str, float]
    arenas: int
    seed: int
    first_arena: int
    snapshot: Snapshot
    version: Version
    local_transport: bool
    distributions: _containers.MessageMap[str, Distribution]
    def __init__(self, game: _Optional[str] = ..., options: _Optional[_Mapping[str, str]] = ..., parameters: _Optional[_Mapping[str, float]] = ..., arenas: _Optional[int] = ..., seed: _Optional[int] = ..., first_arena: _Optional[int] = ..., snapshot: _Optional[_Union[Snapshot, _Mapping]] = ..., version: _Optional[_Union[Version, _Mapping]] = ..., local_transport: bool = ..., distributions: _Optional[_Mapping[str, Distribution]] = ...) -> None: ...

class Distribution(_message.Message):
    __slots__ = ("uniform", "log_uniform", "choice")
    UNIFORM_FIELD_NUMBER: _ClassVar[int]
    LOG_UNIFORM_FIELD_NUMBER: _ClassVar[int]
    CHOICE_FIELD_NUMBER: _ClassVar[int]
    uniform: Interval
    log_uniform: Interval
    choice: Values
    def __init__(self, uniform: _Optional[_Union[Interval, _Mapping]] = ..., log_uniform: _Optional[_Union[Interval, _Mapping]] = ..., choice: _Optional[_Union[Values, _Mapping]] = ...) -> None: ...

class Interval(_message.Message):
    __slots__ = ("low", "high")
    LOW_FIELD_NUMBER: _ClassVar[int]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    low: float
    high: float
    def __init__(self, low: _Optional[float] = ..., high: _Optional[float] = ...) -> None: ...

class Values(_message.Message):
    __slots__ = ("values",)
    VALUES_FIELD_NUMBER: _ClassVar[int]
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, values: _Optional[_Iterable[float]] = ...) -> None: ...

class Started(_message.Message):
    __slots__ = ("spec", "step", "version", "local_socket")
    SPEC_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    LOCAL_SOCKET_FIELD_NUMBER: _ClassVar[int]
    spec: GameSpec
    step: Step
    version: Version
    local_socket: str
    def __init__(self, spec: _Optional[_Union[GameSpec, _Mapping]] = ..., step: _Optional[_Union[Step, _Mapping]] = ..., version: _Optional[_Union[Version, _Mapping]] = ..., local_socket: _Optional[str] = ...) -> None: ...

class Act(_message.Message):
    __slots__ = ("behaviors", "draw", "distributions", "draw_ticks")
    class DistributionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Distribution
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Distribution, _Mapping]] = ...) -> None: ...
    BEHAVIORS_FIELD_NUMBER: _ClassVar[int]
    DRAW_FIELD_NUMBER: _ClassVar[int]
    DISTRIBUTIONS_FIELD_NUMBER: _ClassVar[int]
    DRAW_TICKS_FIELD_NUMBER: _ClassVar[int]
    behaviors: _containers.RepeatedCompositeFieldContainer[BehaviorAct]
    draw: _containers.RepeatedScalarFieldContainer[int]
    distributions: _containers.MessageMap[str, Distribution]
    draw_ticks: int
    def __init__(self, behaviors: _Optional[_Iterable[_Union[BehaviorAct, _Mapping]]] = ..., draw: _Optional[_Iterable[int]] = ..., distributions: _Optional[_Mapping[str, Distribution]] = ..., draw_ticks: _Optional[int] = ...) -> None: ...

class BehaviorAct(_message.Message):
    __slots__ = ("axes", "choices", "scripts")
    AXES_FIELD_NUMBER: _ClassVar[int]
    CHOICES_FIELD_NUMBER: _ClassVar[int]
    SCRIPTS_FIELD_NUMBER: _ClassVar[int]
    axes: Tensor
    choices: Tensor
    scripts: Tensor
    def __init__(self, axes: _Optional[_Union[Tensor, _Mapping]] = ..., choices: _Optional[_Union[Tensor, _Mapping]] = ..., scripts: _Optional[_Union[Tensor, _Mapping]] = ...) -> None: ...

class Reset(_message.Message):
    __slots__ = ("seed", "parameters", "distributions")
    class ParametersEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class DistributionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Distribution
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Distribution, _Mapping]] = ...) -> None: ...
    SEED_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    DISTRIBUTIONS_FIELD_NUMBER: _ClassVar[int]
    seed: int
    parameters: _containers.ScalarMap[str, float]
    distributions: _containers.MessageMap[str, Distribution]
    def __init__(self, seed: _Optional[int] = ..., parameters: _Optional[_Mapping[str, float]] = ..., distributions: _Optional[_Mapping[str, Distribution]] = ...) -> None: ...

class Save(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Snapshot(_message.Message):
    __slots__ = ("parts",)
    class PartsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: bytes
        def __init__(self, key: _Optional[str] = ..., value: _Optional[bytes] = ...) -> None: ...
    PARTS_FIELD_NUMBER: _ClassVar[int]
    parts: _containers.ScalarMap[str, bytes]
    def __init__(self, parts: _Optional[_Mapping[str, bytes]] = ...) -> None: ...

class Step(_message.Message):
    __slots__ = ("behaviors", "pictures", "simulate_seconds", "tick_pictures")
    BEHAVIORS_FIELD_NUMBER: _ClassVar[int]
    PICTURES_FIELD_NUMBER: _ClassVar[int]
    SIMULATE_SECONDS_FIELD_NUMBER: _ClassVar[int]
    TICK_PICTURES_FIELD_NUMBER: _ClassVar[int]
    behaviors: _containers.RepeatedCompositeFieldContainer[BehaviorStep]
    pictures: _containers.RepeatedCompositeFieldContainer[Tensor]
    simulate_seconds: float
    tick_pictures: _containers.RepeatedCompositeFieldContainer[Tensor]
    def __init__(self, behaviors: _Optional[_Iterable[_Union[BehaviorStep, _Mapping]]] = ..., pictures: _Optional[_Iterable[_Union[Tensor, _Mapping]]] = ..., simulate_seconds: _Optional[float] = ..., tick_pictures: _Optional[_Iterable[_Union[Tensor, _Mapping]]] = ...) -> None: ...

class BehaviorStep(_message.Message):
    __slots__ = ("observations", "rewards", "terminated", "truncated", "masks", "deciding", "ended")
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    REWARDS_FIELD_NUMBER: _ClassVar[int]
    TERMINATED_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_FIELD_NUMBER: _ClassVar[int]
    MASKS_FIELD_NUMBER: _ClassVar[int]
    DECIDING_FIELD_NUMBER: _ClassVar[int]
    ENDED_FIELD_NUMBER: _ClassVar[int]
    observations: _containers.RepeatedCompositeFieldContainer[Tensor]
    rewards: Tensor
    terminated: Tensor
    truncated: Tensor
    masks: _containers.RepeatedCompositeFieldContainer[Tensor]
    deciding: Tensor
    ended: Ended
    def __init__(self, observations: _Optional[_Iterable[_Union[Tensor, _Mapping]]] = ..., rewards: _Optional[_Union[Tensor, _Mapping]] = ..., terminated: _Optional[_Union[Tensor, _Mapping]] = ..., truncated: _Optional[_Union[Tensor, _Mapping]] = ..., masks: _Optional[_Iterable[_Union[Tensor, _Mapping]]] = ..., deciding: _Optional[_Union[Tensor, _Mapping]] = ..., ended: _Optional[_Union[Ended, _Mapping]] = ...) -> None: ...

class Ended(_message.Message):
    __slots__ = ("lanes", "final_observations", "metrics", "parameters", "interrupted")
    LANES_FIELD_NUMBER: _ClassVar[int]
    FINAL_OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    INTERRUPTED_FIELD_NUMBER: _ClassVar[int]
    lanes: Tensor
    final_observations: _containers.RepeatedCompositeFieldContainer[Tensor]
    metrics: Tensor
    parameters: Tensor
    interrupted: Tensor
    def __init__(self, lanes: _Optional[_Union[Tensor, _Mapping]] = ..., final_observations: _Optional[_Iterable[_Union[Tensor, _Mapping]]] = ..., metrics: _Optional[_Union[Tensor, _Mapping]] = ..., parameters: _Optional[_Union[Tensor, _Mapping]] = ..., interrupted: _Optional[_Union[Tensor, _Mapping]] = ...) -> None: ...

class Tensor(_message.Message):
    __slots__ = ("dtype", "shape", "data")
    DTYPE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    dtype: Dtype
    shape: _containers.RepeatedScalarFieldContainer[int]
    data: bytes
    def __init__(self, dtype: _Optional[_Union[Dtype, str]] = ..., shape: _Optional[_Iterable[int]] = ..., data: _Optional[bytes] = ...) -> None: ...
