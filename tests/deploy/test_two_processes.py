"""Both controllers walk in a process of their own, over DDS on the loopback interface."""

import re
import signal

import pytest
from deploy_processes import Processes, output

SCHEDULE = "0.1 Start, 1 lower, 5.3 A, 5.8 release, 6.2 ly=0.5, 9 rx=-0.5, 10.5 rx=0, 10.5 ly=0, 13 Select"


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["learned", "qp"])
@pytest.mark.parametrize("network", [[], ["--loss", "0.01", "--jitter", "0.005"]])
def test_walking_over_dds(tmp_path, free_domain, controller, network) -> None:
    with Processes(tmp_path) as processes:
        robot = processes.hugwbc(
            *("simulate-robot", "--lockstep", "--domain", free_domain, "--seed", 6, "--slower", 2, "--duration", 60),
            *("--schedule", SCHEDULE, *network),
        )
        path = tmp_path / "run.bin"
        side = processes.hugwbc(
            *("deploy", "--controller", controller, "--lockstep", "--domain", free_domain, "--duration", 12.6),
            *("--record", path),
        )
        text = output(side)
        assert "start pose -> run" in text and "run -> damping: asked to stop" in text
        assert "0 with a wrong check sum" in text
        robot.send_signal(signal.SIGINT)
        output(robot, 130)
        text = output(processes.hugwbc("deploy", "--replay", path))
        assert "all equal bit for bit" in text and int(re.findall(r"(\d+) states,", text)[0]) > 5000
