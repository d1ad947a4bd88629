"""Fixtures of a robot that stands, as messages."""

import contextlib
import dataclasses
import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np
import pytest
from deploy_bench import EXACT, H1, Standing, make_pilot

from hugwbc import JointCommand
from hugwbc.deploy.messages import Messages
from hugwbc.deploy.pilot import Pilot
from hugwbc.errors import ConfigError
from hugwbc.files import sole_writer
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
    with contextlib.ExitStack() as held:
        for domain in range(100, 200):
            with contextlib.suppress(ConfigError):  # another test has it
                held.enter_context(sole_writer(pathlib.Path(tempfile.gettempdir(), f"hugwbc-domain-{domain}")))
                break
        else:
            pytest.fail("all DDS domains of the tests are in use")
        yield domain


@pytest.fixture
def jumping_pilot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pilots that know of no gaps, for a recording's jump of the clock."""
    monkeypatch.setattr("hugwbc.deploy.pilot.Pilot._fault", lambda self, message: self._watch.fault(message))
