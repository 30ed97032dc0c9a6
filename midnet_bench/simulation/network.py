"""``LossyNetwork``: messages that come late, or never."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from midnet_bench.rng import standard_exponential
from midnet_bench.simulation.world_settings import NetworkSettings

Payload = TypeVar("Payload")


@dataclass(frozen=True)
class Message(Generic[Payload]):
    """What one sender said at one instant."""

    stamp_s: float  # when it was sent
    payload: Payload


class LossyNetwork(Generic[Payload]):
    """Carries the messages of n senders to one receiver, which goes by each sender's newest.

    Each message is lost with a probability, independently of the others, or arrives after a constant delay
    and an exponential one. Messages may overtake each other. A sender's generator gives two numbers for each
    message whatever the settings are: settings are compared on the same draws.
    """

    def __init__(self, settings: NetworkSettings, rngs: Sequence[np.random.Generator]) -> None:
        """Nothing is under way; one generator for each sender."""
        self._settings = settings
        self._rngs = rngs
        self._under_way: list[list[tuple[float, Message[Payload]]]] = [[] for _ in rngs]
        self._newest: list[Message[Payload] | None] = [None for _ in rngs]

    def send(self, sender: int, payload: Payload, time_s: float) -> None:
        """Put a message of sender number ``sender`` on its way, stamped ``time_s``."""
        rng, settings = self._rngs[sender], self._settings
        is_lost = rng.random() < settings.loss
        arrives_s = time_s + settings.delay_s + settings.jitter_s * standard_exponential(rng)
        if not is_lost:
            self._under_way[sender].append((arrives_s, Message(time_s, payload)))

    def latest(self, sender: int, time_s: float) -> Message[Payload] | None:
        """Of that sender's messages which have arrived by ``time_s``, the one with the latest stamp.

        None if none has. Time may not run backwards from call to call.
        """
        messages, newest = self._under_way[sender], self._newest[sender]
        for arrives_s, message in messages:
            if arrives_s <= time_s + 1e-9 and (newest is None or message.stamp_s > newest.stamp_s):
                newest = message
        self._under_way[sender] = [one for one in messages if one[0] > time_s + 1e-9]
        self._newest[sender] = newest
        return newest
