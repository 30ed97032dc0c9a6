"""The network between guards and MIDNet: what arrives, when, and in which order."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.experiments.guarded.guarded_arena import LossyNetwork, Message
from midnet_bench.rng import stream
from midnet_bench.simulation.world_settings import NetworkSettings


def network(settings: NetworkSettings, senders: int = 1, seed: int = 1) -> LossyNetwork[int]:
    return LossyNetwork(settings, [stream(seed, "network", f"guard {i + 1}") for i in range(senders)])


def test_a_delay_by_hand() -> None:
    at_once = network(NetworkSettings())
    at_once.send(0, 7, 0.1)
    assert at_once.latest(0, 0.1) == Message(0.1, 7)
    link = network(NetworkSettings(delay_s=0.3))
    for number, time_s in enumerate((0.1, 0.2, 0.3)):
        link.send(0, number, time_s)
    assert link.latest(0, 0.39) is None
    assert link.latest(0, 0.4) == Message(0.1, 0)
    assert link.latest(0, 0.49) == Message(0.1, 0)
    assert link.latest(0, 5.0) == Message(0.3, 2)
    link.send(0, 3, 5.0)
    assert link.latest(0, 5.2) == Message(0.3, 2)
    assert link.latest(0, 5.3) == Message(5.0, 3)


def test_an_overtaken_message_is_not_gone_back_to() -> None:
    """Jitter far above the interval: many arrive late, and none of them replaces a newer one."""
    link = network(NetworkSettings(jitter_s=2.0))
    stamps, overtaken = [], 0
    for number in range(400):
        link.send(0, number, 0.1 * number)
        message = link.latest(0, 0.1 * number)
        stamps.append(-1.0 if message is None else message.stamp_s)
        overtaken += number - (message.payload if message else number) > 0
    assert stamps == sorted(stamps)
    assert overtaken > 200


@pytest.mark.parametrize("loss", [0.0, 0.01, 0.2, 1.0])
def test_as_many_messages_are_lost_as_set(loss: float) -> None:
    link, sent = network(NetworkSettings(loss=loss)), 20_000
    arrived = 0
    for number in range(sent):
        link.send(0, number, float(number))
        message = link.latest(0, float(number))
        arrived += message is not None and message.payload == number
    assert abs(sent - arrived - loss * sent) <= 4.0 * math.sqrt(sent * loss * (1.0 - loss))


def test_delays_have_the_mean_that_is_set() -> None:
    link, delays = network(NetworkSettings(delay_s=0.5, jitter_s=0.2)), []
    for number in range(1000):
        link.send(0, number, 10.0 * number)
        for step in range(500):  # asks every hundredth of a second
            message = link.latest(0, 10.0 * number + 0.01 * step)
            if message is not None and message.payload == number:
                delays.append(0.01 * step)
                break
    assert len(delays) == 1000
    assert min(delays) >= 0.5
    assert sum(delays) / len(delays) == pytest.approx(0.705, abs=0.025)


settings = st.builds(
    NetworkSettings, delay_s=st.floats(0.0, 2.0), jitter_s=st.floats(0.0, 2.0), loss=st.floats(0.0, 1.0)
)


@given(settings, st.integers(0, 100), st.lists(st.integers(1, 9), min_size=1, max_size=40))
def test_no_message_comes_from_the_future_or_before_its_delay(
    chosen: NetworkSettings, seed: int, gaps: list[int]
) -> None:
    link, time_s, last_s = network(chosen, seed=seed), 0.0, -1.0
    for gap in gaps:
        time_s += 0.1 * gap
        link.send(0, gap, time_s)
        message = link.latest(0, time_s)
        if message is not None:
            assert message.stamp_s + chosen.delay_s <= time_s + 1e-6
            assert message.stamp_s >= last_s
            last_s = message.stamp_s


@given(st.integers(0, 100), st.lists(st.integers(0, 2), min_size=1, max_size=40))
def test_what_a_sender_meets_depends_on_nobody_else(seed: int, senders: list[int]) -> None:
    chosen = NetworkSettings(delay_s=0.2, jitter_s=0.3, loss=0.3)
    together, alone = network(chosen, 3, seed), network(chosen, 3, seed)
    for number, sender in enumerate(senders):
        together.send(sender, number, 0.1 * number)
        if sender == 1:
            alone.send(1, number, 0.1 * number)
        assert together.latest(1, 0.1 * number) == alone.latest(1, 0.1 * number)


@given(st.integers(0, 100), st.floats(0.0, 1.0))
def test_a_higher_loss_loses_the_same_messages_and_more(seed: int, loss: float) -> None:
    """Common random numbers: settings are compared on the same draws."""
    heard: list[set[int]] = []
    for share in (loss, loss / 2.0):
        link, found = network(NetworkSettings(loss=share), seed=seed), set()
        for number in range(40):
            link.send(0, number, float(number))
            if (message := link.latest(0, float(number))) is not None:
                found.add(message.payload)
        heard.append(found)
    assert heard[0] <= heard[1]
