import pytest

from hugwbc.cli import main


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--schedule", "1 Strat"], "'1 Strat' in the schedule is not valid"),
        (["--net", "eth0"], "could be taken for a real one; use --net lo"),
        (["--domain", "-1"], "DDS domain is -1"),
        (["--slower", "0.1"], "slower is 0.1; it should be greater than or equal to 1"),
        (["--duration", "0"], "duration is 0"),
        (["--loss", "1"], "loss is 1"),
        (["--jitter", "-1"], "jitter is -1"),
        (["--robot", "h2"], "unknown robot 'h2'"),
    ],
)
def test_simulate_robot_refuses_what_it_cannot_do(words, message, capsys) -> None:
    assert main(["simulate-robot", *words]) == 2
    assert message in capsys.readouterr().err
