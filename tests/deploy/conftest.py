"""Fixtures of a robot that stands, as messages."""

import dataclasses
import fcntl
import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np
import pytest
from deploy_bench import EXACT, H1, Standing, make_pilot

from hugwbc import JointCommand
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Pilot
from hugwbc.runtime import Simulation
from hugwbc.state import RobotState


@pytest.fixture(scope="session")
def still() -> RobotState:
    """A reading of a robot that stands still by its joints' stiffness."""
    simulation = Simulation(sensing=EXACT)
    simulation.step(JointCommand.position(H1, H1.nominal), 0.4)
    return dataclasses.replace(simulation.sense(), dq=np.zeros(19))


@pytest.fixture
def standing(still: RobotState) -> Standing:
    return Standing(still, Messages(H1))


@pytest.fixture
def pilot() -> Pilot:
    """A pilot whose controller holds the nominal pose."""
    return make_pilot()


@pytest.fixture
def free_domain() -> Iterator[int]:
    """A DDS domain that no other test on this machine uses at the same time."""
    for domain in range(100, 200):
        with open(pathlib.Path(tempfile.gettempdir()) / f"hugwbc-domain-{domain}", "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail("all DDS domains of the tests are in use")


@pytest.fixture
def jumping_pilot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pilots that know of no gaps, for a recording's jump of the clock."""
    monkeypatch.setattr("hugwbc.deploy.pilot.Pilot._fault", lambda self, message: self._watch.fault(message))
