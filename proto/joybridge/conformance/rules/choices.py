"""Every choice of every option is played, and keeps the rules that the default choices keep."""

from joybridge.conformance.expectations import NotApplicable, Suspicion, Violation, skip_unless
from joybridge.conformance.registry import Check, check, checks_of
from joybridge.conformance.subject import Subject

PLAYED = 100  # decisions of each choice


@check("Option")
def every_choice_plays_by_the_rules(subject: Subject) -> None:
    """Every step of a session is valid and the same in a second session, with every choice of every option."""
    others = [(o.name, choice) for o in subject.spec.options for choice in o.choices if choice != o.default_choice]
    skip_unless(others, "the game has no options, or no choices but the default")
    for name, choice in others:
        _play(Subject(subject.client, subject.game, {name: choice}, PLAYED))


def _play(subject: Subject) -> None:
    """Run the checks of steps under the options of a subject. Raises Violation, which names the check."""
    for rule in _rules():
        try:
            rule.run(subject)
        except (NotApplicable, Suspicion):
            continue
        except Violation as violation:
            got = f"{violation.got} with {subject.options} ({rule.name})"
            raise type(violation)(got, violation.expected) from violation


def _rules() -> list[Check]:
    """Return the checks of the first step, of later steps and of ends, and that of determinism."""
    first = [rule for rule in checks_of("start") if rule.name.startswith("first_")]
    same = [rule for rule in checks_of("seeds") if rule.name == "same_seed_gives_the_same_bytes"]
    return [*first, *checks_of("steps"), *checks_of("episode_ends"), *same]
