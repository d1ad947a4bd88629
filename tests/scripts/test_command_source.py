from hugwbc import Command, Gait
from hugwbc.scripts import Constant
from hugwbc.targets import HandTargets


def test_a_constant_source_gives_the_same_at_all_times():
    command, hands = Command(v_x=0.5, gait=Gait.WALKING), HandTargets.of((0.3, 0.2, 0.1), None)
    source = Constant(command, hands)
    assert all(source.command_at(t) is command and source.hands_at(t) is hands for t in (0.0, 1.5, 100.0))
    assert Constant(command).hands_at(0.0) is None
