from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Command(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    STEP: _ClassVar[Command]
    RESET: _ClassVar[Command]
    QUIT: _ClassVar[Command]

class Compression(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    NONE: _ClassVar[Compression]
    PNG: _ClassVar[Compression]
STEP: Command
RESET: Command
QUIT: Command
NONE: Compression
PNG: Compression

class Message(_message.Message):
    __slots__ = ("header", "from_player", "from_trainer")
    HEADER_FIELD_NUMBER: _ClassVar[int]
    FROM_PLAYER_FIELD_NUMBER: _ClassVar[int]
    FROM_TRAINER_FIELD_NUMBER: _ClassVar[int]
    header: Header
    from_player: FromPlayer
    from_trainer: FromTrainer
    def __init__(self, header: _Optional[_Union[Header, _Mapping]] = ..., from_player: _Optional[_Union[FromPlayer, _Mapping]] = ..., from_trainer: _Optional[_Union[FromTrainer, _Mapping]] = ...) -> None: ...

class Header(_message.Message):
    __slots__ = ("status",)
    STATUS_FIELD_NUMBER: _ClassVar[int]
    status: int
    def __init__(self, status: _Optional[int] = ...) -> None: ...

class FromPlayer(_message.Message):
    __slots__ = ("step", "hello")
    STEP_FIELD_NUMBER: _ClassVar[int]
    HELLO_FIELD_NUMBER: _ClassVar[int]
    step: PlayerStep
    hello: PlayerHello
    def __init__(self, step: _Optional[_Union[PlayerStep, _Mapping]] = ..., hello: _Optional[_Union[PlayerHello, _Mapping]] = ...) -> None: ...

class FromTrainer(_message.Message):
    __slots__ = ("step", "hello")
    STEP_FIELD_NUMBER: _ClassVar[int]
    HELLO_FIELD_NUMBER: _ClassVar[int]
    step: TrainerStep
    hello: TrainerHello
    def __init__(self, step: _Optional[_Union[TrainerStep, _Mapping]] = ..., hello: _Optional[_Union[TrainerHello, _Mapping]] = ...) -> None: ...

class PlayerHello(_message.Message):
    __slots__ = ("name", "communication_version", "behaviors", "package_version", "capabilities")
    NAME_FIELD_NUMBER: _ClassVar[int]
    COMMUNICATION_VERSION_FIELD_NUMBER: _ClassVar[int]
    BEHAVIORS_FIELD_NUMBER: _ClassVar[int]
    PACKAGE_VERSION_FIELD_NUMBER: _ClassVar[int]
    CAPABILITIES_FIELD_NUMBER: _ClassVar[int]
    name: str
    communication_version: str
    behaviors: _containers.RepeatedCompositeFieldContainer[BehaviorParameters]
    package_version: str
    capabilities: Capabilities
    def __init__(self, name: _Optional[str] = ..., communication_version: _Optional[str] = ..., behaviors: _Optional[_Iterable[_Union[BehaviorParameters, _Mapping]]] = ..., package_version: _Optional[str] = ..., capabilities: _Optional[_Union[Capabilities, _Mapping]] = ...) -> None: ...

class TrainerHello(_message.Message):
    __slots__ = ("seed", "communication_version", "package_version", "capabilities", "num_areas")
    SEED_FIELD_NUMBER: _ClassVar[int]
    COMMUNICATION_VERSION_FIELD_NUMBER: _ClassVar[int]
    PACKAGE_VERSION_FIELD_NUMBER: _ClassVar[int]
    CAPABILITIES_FIELD_NUMBER: _ClassVar[int]
    NUM_AREAS_FIELD_NUMBER: _ClassVar[int]
    seed: int
    communication_version: str
    package_version: str
    capabilities: Capabilities
    num_areas: int
    def __init__(self, seed: _Optional[int] = ..., communication_version: _Optional[str] = ..., package_version: _Optional[str] = ..., capabilities: _Optional[_Union[Capabilities, _Mapping]] = ..., num_areas: _Optional[int] = ...) -> None: ...

class Capabilities(_message.Message):
    __slots__ = ("base", "concatenated_png", "channel_mapping", "hybrid_actions", "training_analytics", "variable_length", "groups")
    BASE_FIELD_NUMBER: _ClassVar[int]
    CONCATENATED_PNG_FIELD_NUMBER: _ClassVar[int]
    CHANNEL_MAPPING_FIELD_NUMBER: _ClassVar[int]
    HYBRID_ACTIONS_FIELD_NUMBER: _ClassVar[int]
    TRAINING_ANALYTICS_FIELD_NUMBER: _ClassVar[int]
    VARIABLE_LENGTH_FIELD_NUMBER: _ClassVar[int]
    GROUPS_FIELD_NUMBER: _ClassVar[int]
    base: bool
    concatenated_png: bool
    channel_mapping: bool
    hybrid_actions: bool
    training_analytics: bool
    variable_length: bool
    groups: bool
    def __init__(self, base: bool = ..., concatenated_png: bool = ..., channel_mapping: bool = ..., hybrid_actions: bool = ..., training_analytics: bool = ..., variable_length: bool = ..., groups: bool = ...) -> None: ...

class PlayerStep(_message.Message):
    __slots__ = ("agents", "side_channels")
    class AgentsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: bytes
        def __init__(self, key: _Optional[str] = ..., value: _Optional[bytes] = ...) -> None: ...
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    SIDE_CHANNELS_FIELD_NUMBER: _ClassVar[int]
    agents: _containers.ScalarMap[str, bytes]
    side_channels: bytes
    def __init__(self, agents: _Optional[_Mapping[str, bytes]] = ..., side_channels: _Optional[bytes] = ...) -> None: ...

class TrainerStep(_message.Message):
    __slots__ = ("actions", "command", "side_channels")
    class ActionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: bytes
        def __init__(self, key: _Optional[str] = ..., value: _Optional[bytes] = ...) -> None: ...
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    COMMAND_FIELD_NUMBER: _ClassVar[int]
    SIDE_CHANNELS_FIELD_NUMBER: _ClassVar[int]
    actions: _containers.ScalarMap[str, bytes]
    command: Command
    side_channels: bytes
    def __init__(self, actions: _Optional[_Mapping[str, bytes]] = ..., command: _Optional[_Union[Command, str]] = ..., side_channels: _Optional[bytes] = ...) -> None: ...

class AgentList(_message.Message):
    __slots__ = ("agents",)
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    agents: _containers.RepeatedCompositeFieldContainer[Agent]
    def __init__(self, agents: _Optional[_Iterable[_Union[Agent, _Mapping]]] = ...) -> None: ...

class ActionList(_message.Message):
    __slots__ = ("actions",)
    ACTIONS_FIELD_NUMBER: _ClassVar[int]
    actions: _containers.RepeatedCompositeFieldContainer[Action]
    def __init__(self, actions: _Optional[_Iterable[_Union[Action, _Mapping]]] = ...) -> None: ...

class Agent(_message.Message):
    __slots__ = ("reward", "done", "interrupted", "id", "action_mask", "observations", "group_id", "group_reward")
    REWARD_FIELD_NUMBER: _ClassVar[int]
    DONE_FIELD_NUMBER: _ClassVar[int]
    INTERRUPTED_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    ACTION_MASK_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    GROUP_ID_FIELD_NUMBER: _ClassVar[int]
    GROUP_REWARD_FIELD_NUMBER: _ClassVar[int]
    reward: float
    done: bool
    interrupted: bool
    id: int
    action_mask: bytes
    observations: _containers.RepeatedCompositeFieldContainer[Observation]
    group_id: int
    group_reward: float
    def __init__(self, reward: _Optional[float] = ..., done: bool = ..., interrupted: bool = ..., id: _Optional[int] = ..., action_mask: _Optional[bytes] = ..., observations: _Optional[_Iterable[_Union[Observation, _Mapping]]] = ..., group_id: _Optional[int] = ..., group_reward: _Optional[float] = ...) -> None: ...

class Action(_message.Message):
    __slots__ = ("continuous", "discrete")
    CONTINUOUS_FIELD_NUMBER: _ClassVar[int]
    DISCRETE_FIELD_NUMBER: _ClassVar[int]
    continuous: bytes
    discrete: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, continuous: _Optional[bytes] = ..., discrete: _Optional[_Iterable[int]] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("shape", "compression", "compressed", "floats", "channel_mapping", "dimension_properties", "observation_type", "name")
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    COMPRESSION_FIELD_NUMBER: _ClassVar[int]
    COMPRESSED_FIELD_NUMBER: _ClassVar[int]
    FLOATS_FIELD_NUMBER: _ClassVar[int]
    CHANNEL_MAPPING_FIELD_NUMBER: _ClassVar[int]
    DIMENSION_PROPERTIES_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_TYPE_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    shape: _containers.RepeatedScalarFieldContainer[int]
    compression: Compression
    compressed: bytes
    floats: Floats
    channel_mapping: _containers.RepeatedScalarFieldContainer[int]
    dimension_properties: _containers.RepeatedScalarFieldContainer[int]
    observation_type: int
    name: str
    def __init__(self, shape: _Optional[_Iterable[int]] = ..., compression: _Optional[_Union[Compression, str]] = ..., compressed: _Optional[bytes] = ..., floats: _Optional[_Union[Floats, _Mapping]] = ..., channel_mapping: _Optional[_Iterable[int]] = ..., dimension_properties: _Optional[_Iterable[int]] = ..., observation_type: _Optional[int] = ..., name: _Optional[str] = ...) -> None: ...

class Floats(_message.Message):
    __slots__ = ("data",)
    DATA_FIELD_NUMBER: _ClassVar[int]
    data: bytes
    def __init__(self, data: _Optional[bytes] = ...) -> None: ...

class BehaviorParameters(_message.Message):
    __slots__ = ("name", "action_spec")
    NAME_FIELD_NUMBER: _ClassVar[int]
    ACTION_SPEC_FIELD_NUMBER: _ClassVar[int]
    name: str
    action_spec: ActionSpec
    def __init__(self, name: _Optional[str] = ..., action_spec: _Optional[_Union[ActionSpec, _Mapping]] = ...) -> None: ...

class ActionSpec(_message.Message):
    __slots__ = ("continuous_actions", "discrete_actions", "branch_sizes")
    CONTINUOUS_ACTIONS_FIELD_NUMBER: _ClassVar[int]
    DISCRETE_ACTIONS_FIELD_NUMBER: _ClassVar[int]
    BRANCH_SIZES_FIELD_NUMBER: _ClassVar[int]
    continuous_actions: int
    discrete_actions: int
    branch_sizes: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, continuous_actions: _Optional[int] = ..., discrete_actions: _Optional[int] = ..., branch_sizes: _Optional[_Iterable[int]] = ...) -> None: ...

class DemonstrationHeading(_message.Message):
    __slots__ = ("api_version", "name", "steps", "episodes", "mean_reward")
    API_VERSION_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    STEPS_FIELD_NUMBER: _ClassVar[int]
    EPISODES_FIELD_NUMBER: _ClassVar[int]
    MEAN_REWARD_FIELD_NUMBER: _ClassVar[int]
    api_version: int
    name: str
    steps: int
    episodes: int
    mean_reward: float
    def __init__(self, api_version: _Optional[int] = ..., name: _Optional[str] = ..., steps: _Optional[int] = ..., episodes: _Optional[int] = ..., mean_reward: _Optional[float] = ...) -> None: ...

class DemonstrationStep(_message.Message):
    __slots__ = ("agent", "action")
    AGENT_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    agent: Agent
    action: Action
    def __init__(self, agent: _Optional[_Union[Agent, _Mapping]] = ..., action: _Optional[_Union[Action, _Mapping]] = ...) -> None: ...
