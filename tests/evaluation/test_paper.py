import pytest

from hugwbc import Gait
from hugwbc.evaluation import paper


def test_figures_of_single_commands_and_of_others():
    walking, noise = paper.single_command_errors(Gait.WALKING), paper.single_command_errors(Gait.WALKING, "noise")
    assert tuple(walking) == tuple(paper.ERROR_UNITS) and (walking["E_vx_low"], walking["E_l"]) == (0.030, 0.011)
    assert set(paper.single_command_errors(Gait.STANDING)) == {"E_h", "E_p", "E_w"}
    assert paper.single_command_errors(Gait.HOPPING_LEFT) == paper.single_command_errors(Gait.HOPPING_RIGHT)
    assert noise["E_vx"] == 0.0483 and noise["E_w"] == 0.0552 and "E_vx_low" not in noise
    assert paper.single_command_errors(Gait.STANDING, "motion") == {"E_h": 0.0237, "E_p": 0.0611, "E_w": 0.0624}
    assert paper.single_command_errors(Gait.HOPPING_LEFT, "noise") == {}
    assert paper.real_robot_errors(Gait.STANDING) == {"E_p": 0.0712, "E_w": 0.0718}
    others = paper.other_controllers()
    assert others["ExBody"]["E_omega"] == 0.587 and others["HOVER"]["E_vx_high"] == 1.324


def test_figures_of_the_ablation():
    assert paper.intervention_errors(Gait.JUMPING, "noise", "motion")["E_l"] == 0.2560
    assert paper.intervention_errors(Gait.WALKING, "none")["E_vx"] == 0.0264
    for training in paper.TRAININGS:
        for intervention in ("noise", "motion", "none"):
            assert len(paper.intervention_errors(Gait.WALKING, intervention, training)) == 8
            assert set(paper.foot_displacement(intervention, training)) == {"h", "p", "w"}
    assert paper.foot_displacement("motion") == {"h": 0.0454, "p": 0.0728, "w": 0.0196}
    assert paper.foot_displacement("noise", "none")["w"] == 25.7132


@pytest.mark.parametrize(
    ("command", "value", "name"),
    [("v_x", 1.0, "E_vx_low"), ("v_x", 1.01, "E_vx_high"), ("v_x", -0.6, "E_vx_low"), ("v_y", 0.5, "E_vy"),
     ("omega", 1.0, "E_omega"), ("f", 3.0, "E_f"), ("w", 1.0, "E_w")],
)  # fmt: skip
def test_names_of_errors(command, value, name):
    assert paper.error_name(command, value) == name
