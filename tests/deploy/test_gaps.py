"""Gaps in the connection: what holding the last command, or damping, does to a robot that stands or walks."""

import numpy as np
import pytest
from deploy_bench import H1, Pair

from hugwbc.deploy import state_machine
from hugwbc.deploy.remote import Sticks
from hugwbc.deploy.watchdogs import Limits
from hugwbc.runtime import load_controller

RUNS, GAPS = 2, 10


def falls(name: str, speed: str, gap: float, silence: float) -> int:
    """How many runs of ten gaps [s] end in a fall, if the joints are damped after a silence [s]."""
    fallen = 0
    for seed in range(RUNS):
        schedule = f"0.02 Start, 0.1 lower, 1.3 A, 1.6 release, 1.8 ly={speed}"
        pair = Pair(load_controller(name), schedule, source=Sticks(H1))
        pair.pilot.limits = Limits(silence=1.0)
        pair.run(3.0)
        rng = np.random.default_rng(seed)
        for _ in range(GAPS):
            pair.run(pair.robot.time + float(rng.uniform(1.0, 1.5)))
            begin = pair.robot.time
            pair.run(begin + min(gap, silence), alive=lambda: False)
            if gap > silence:
                pair.robot._command = state_machine.damping(H1)
                pair.run(begin + gap, alive=lambda: False)
            pair.side._endpoint.receive(0.0)  # what was sent meanwhile is lost
        fallen += pair.robot.simulation.fallen
    return fallen


@pytest.mark.slow
@pytest.mark.parametrize("name", ["learned", "qp"])
def test_holding_the_last_command_over_a_gap_beats_damping(monkeypatch, name) -> None:
    """Printed: docs/deploy.md. No robot falls that holds its command over 20 ms, or stands and holds it over 50 ms."""
    monkeypatch.setattr(state_machine, "START_TIME", 0.4)
    found = {}
    for gap in (0.02, 0.05, 0.1):
        for speed in ("0", "0.5"):
            for silence in (1.0, 0.0):
                fallen = found[gap, speed, silence] = falls(name, speed, gap, silence)
                what = "held" if silence else "damped"
                print(f"{name}, {speed} m/s, {1e3 * gap:.0f} ms {what}: {fallen} of {RUNS} runs fell")
    held = {(gap, speed): count for (gap, speed, silence), count in found.items() if silence}
    assert all(count <= found[gap, speed, 0.0] for (gap, speed), count in held.items())
    assert sum(held.values()) < sum(found.values()) - sum(held.values())
    assert not any(count for (gap, speed), count in held.items() if gap <= 0.02 or (gap <= 0.05 and speed == "0"))
