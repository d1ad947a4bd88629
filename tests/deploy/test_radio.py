"""A network that loses, delays and shuffles messages."""

import numpy as np
import pytest

from hugwbc.deploy.radio import Channel, Radio
from hugwbc.errors import ConfigError


def arrivals(radio: Radio, count: int = 2000, delay: float = 0.0) -> tuple[Channel, list[tuple[int, float]]]:
    channel: Channel[int] = Channel(radio, np.random.default_rng(0), delay)
    arrived = []
    for step in range(count + 50):
        now = 0.002 * step
        if step < count:
            channel.put(step, now)
        arrived += [(message, now - 0.002 * message) for message in channel.take(now)]
    return channel, arrived


def test_a_good_network_passes_everything_at_once() -> None:
    channel, arrived = arrivals(Radio())
    assert [message for message, _ in arrived] == list(range(2000)) and channel.lost == 0
    assert max(took for _, took in arrived) < 1e-9


def test_a_delay_holds_for_every_message() -> None:
    _, arrived = arrivals(Radio(delay=0.006), delay=0.004)
    np.testing.assert_allclose([took for _, took in arrived], 0.01, atol=1e-6)


def test_losses_have_their_rate() -> None:
    channel, arrived = arrivals(Radio(loss=0.1))
    assert len(arrived) + channel.lost == 2000
    assert channel.lost == pytest.approx(200, abs=50)


def test_jitter_lets_messages_overtake_each_other() -> None:
    _, arrived = arrivals(Radio(jitter=0.01))
    order, took = zip(*arrived, strict=True)
    assert sorted(order) == list(range(2000)) and list(order) != sorted(order)
    assert min(took) >= 0.0 and max(took) <= 0.012 and np.mean(took) == pytest.approx(0.006, abs=0.001)


@pytest.mark.parametrize(
    ("name", "value"),
    [("loss", 1.0), ("loss", -0.1), ("loss", float("nan")), ("delay", -1.0), ("jitter", float("inf"))],
)
def test_a_network_out_of_range_is_refused(name, value) -> None:
    with pytest.raises(ConfigError, match=name):
        Radio(**{name: value})
