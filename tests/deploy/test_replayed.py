"""The record of a replayed deployment, for the viewer."""

import numpy as np
from deploy_bench import bring_to

from hugwbc import load_robot
from hugwbc.deploy.replayed import ReplayedRun
from hugwbc.deploy.state_machine import Mode
from hugwbc.viz.replay import replay_html

H1 = load_robot()


def test_the_record_holds_the_estimates_at_50_hz(pilot, standing) -> None:
    run, expected = ReplayedRun(H1), []
    bring_to(Mode.RUN, pilot, standing)
    for step in range(101):
        pilot.observe(standing.next())
        run.add(pilot)
        if step % 10 == 0:
            assert pilot.estimate is not None and pilot.estimate.position is not None
            expected.append(np.concatenate((pilot.estimate.position, pilot.estimate.orientation, pilot.estimate.q)))
    trace = run.trace("qp", pilot)
    assert trace is not None
    np.testing.assert_array_equal(trace.qpos, expected)
    np.testing.assert_allclose(trace.time, 0.02 * np.arange(11), atol=1e-9)
    assert trace.foot_contact.all() and not trace.fell
    assert len(replay_html([trace], title="a replay")) > 100_000


def test_without_an_estimate_there_is_no_record(pilot) -> None:
    run = ReplayedRun(H1)
    run.add(pilot)
    assert run.trace("qp", pilot) is None
