"""Servers without health, reflection, limits or a token."""

from dataclasses import replace

from grpc_reflection.v1alpha import reflection

from joybridge.contract.credentials import Credentials, bearer
from tests.support.broken_servers.serving import BROKEN, BrokenServer

BROKEN["NoHealth"] = BrokenServer({"health_of_the_server_is_serving", "health_of_the_service_is_serving"}, health=())
BROKEN["HealthOfTheServerOnly"] = BrokenServer({"health_of_the_service_is_serving"}, health=("",))
BROKEN["NoReflection"] = BrokenServer(
    {
        "reflection_lists_the_service",
        "reflection_has_every_method",
        "reflection_has_every_field",
    },
    reflection=(),
)
BROKEN["ReflectionOfNothing"] = BrokenServer({"reflection_lists_the_service"}, reflection=(reflection.SERVICE_NAME,))
BROKEN["NoLimitOfMessages"] = BrokenServer(
    set(), warned={"oversized_message_is_refused"}, options=[("grpc.max_receive_message_length", -1)]
)

HEALTH = "/grpc.health.v1.Health/"
RIGHT = bearer("0123456789-secret")
PROTECTED = BrokenServer(
    set(),
    admits=lambda method, sent: sent == RIGHT or method.startswith(HEALTH),
    credentials=Credentials(token="0123456789-secret"),
)
WITHOUT, ANOTHER = "calls_without_the_token_are_unauthenticated", "calls_with_another_token_are_unauthenticated"
BROKEN |= {
    "AnyToken": replace(
        PROTECTED, checks={ANOTHER}, admits=lambda method, sent: sent != "" or method.startswith(HEALTH)
    ),
    "BeginningOfTheToken": replace(
        PROTECTED, checks={ANOTHER}, admits=lambda method, sent: sent.startswith(RIGHT) or method.startswith(HEALTH)
    ),
    "PlayIsOpen": replace(
        PROTECTED,
        checks={WITHOUT, ANOTHER},
        admits=lambda method, sent: sent == RIGHT or method.endswith("/Play") or method.startswith(HEALTH),
    ),
    "ReflectionIsOpen": replace(
        PROTECTED,
        checks={WITHOUT, ANOTHER},
        admits=lambda method, sent: sent == RIGHT or method.startswith(("/grpc.reflection", HEALTH)),
    ),
    "HealthNeedsTheToken": replace(
        PROTECTED, checks={"health_needs_no_token"}, admits=lambda method, sent: sent == RIGHT
    ),
    "UnpacksMessages": BrokenServer(
        set(), warned={"compressed_messages_are_refused"}, options=[("grpc.compression_enabled_algorithms_bitset", 7)]
    ),
}
