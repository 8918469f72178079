"""Servers that break rules of the order of requests, and of versions."""

from joybridge.contract.versions import own_version
from joybridge.simulator import session as sessions
from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers.serving import Honest, broken


@broken("act_before_start_is_refused", "reset_before_start_is_refused", "save_before_start_is_refused")
class WrongStatusBeforeStart(Honest):
    def answer(self, request):
        if self.game is None and request.WhichOneof("request") in ("act", "reset", "save"):
            raise Refusal(pb.REASON_UNKNOWN_REQUEST, "start comes first")
        return super().answer(request)


@broken("second_start_is_refused", "start_after_act_and_reset_is_refused")
class StartsAgain(Honest):
    def answer(self, request):
        if request.HasField("start"):
            self.game = None
        return super().answer(request)


@broken(
    "unknown_field_of_start_is_ignored",
    "unknown_field_of_act_is_ignored",
    "unknown_field_of_describe_is_ignored",
)
class RefusesWhatItDoesNotKnow(Honest):
    @staticmethod
    def look(request):
        Honest.look(request)
        known = type(request)()
        known.CopyFrom(request)
        known.DiscardUnknownFields()
        if known.ByteSize() != request.ByteSize():
            raise Refusal(pb.REASON_MALFORMED_MESSAGE, "a field is unknown")

    def request(self, request):
        kind = request.WhichOneof("request")
        if kind in ("start", "act"):
            part = getattr(request, kind)
            size = part.ByteSize()
            part.DiscardUnknownFields()
            if part.ByteSize() != size:
                raise Refusal(pb.REASON_MALFORMED_MESSAGE, "a field is unknown")
        return request


@broken("every_response_states_product_and_revision", "all_responses_state_the_same_version")
class StatesNoVersion(Honest):
    @staticmethod
    def version():
        return None


@broken("client_that_needs_a_newer_revision_is_refused")
class ServesEveryRevision(Honest):
    @staticmethod
    def look(request):
        pass

    def request(self, request):
        if request.HasField("start"):
            request.start.ClearField("version")
        return request


@broken("client_of_the_same_revision_is_served")
class ServesOnlyWhoStatesNoRevision(Honest):
    @staticmethod
    def look(request):
        if request.version.revision:
            client = request.version
            raise Refusal(
                pb.REASON_OLD_SERVER,
                f"{client.product} {client.revision} is not {own_version().product} {own_version().revision}",
            )


@broken("unknown_game_is_not_found_by_describe", "empty_game_name_is_not_found_by_describe")
class UnknownGameIsInvalid(Honest):
    @staticmethod
    def describe(games, name, options):
        if name not in games:
            raise Refusal(pb.REASON_UNKNOWN_OPTION, f"no game {name}")
        return sessions.describe(games, name, options)
