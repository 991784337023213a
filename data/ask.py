"""What a recording is asked: which signal answers which, and how a model of it is judged."""

from dataclasses import dataclass

from data.options import option


@dataclass(frozen=True, kw_only=True)
class Ask:
    """The `[ask]` table of a scene or an import mapping. Empty fields are chosen from the topics.

    response, input: topics, or "topic:component". others: further signals a model may use.
    split: how data are held out, "half" (the second half of the time) or "steps" (every other
    level of a staircase).
    """

    response: str = ""
    input: str = ""
    others: tuple[str, ...] = ()
    split: str = option("half", choices=("half", "steps"))
