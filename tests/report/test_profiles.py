import pytest

from hugwbc.errors import UnknownNameError
from hugwbc.learned.policy import save_policy
from hugwbc.learned.policy.contract import policy_contract
from hugwbc.learned.policy.networks import Actor
from hugwbc.report.profiles import profile_cells
from hugwbc.report.report_page import sections
from hugwbc.runtime.controllers import ControllerSpec

SPECS = [ControllerSpec("learned"), ControllerSpec("qp")]


@pytest.mark.parametrize("profile", ["quick", "full"])
def test_a_profile_has_every_protocol_of_the_report_for_every_controller(profile):
    cells = profile_cells(profile, SPECS, seed=3)
    assert {cell.protocol for cell in cells} == {p.name for p in sections() if not p.unavailable()}
    assert {p.name for p in sections() if p.unavailable()} <= {"engines"}
    assert [cell.spec for cell in cells] == SPECS * (len(cells) // 2)
    assert {cell.config.seed for cell in cells} == {3}


@pytest.fixture
def motion_policy(tmp_path):
    """A policy whose record says that motions moved the arms in its training."""
    record = {"config": {"env": {"intervention": "motion"}}}
    save_policy(tmp_path / "mine" / "policy.safetensors", Actor(), policy_contract(), record)
    return ControllerSpec("learned", tmp_path / "mine")


def test_policies_of_the_ablation_run_where_the_arms_are_moved_beside_the_papers_of_their_training(motion_policy):
    cells = profile_cells("quick", SPECS, [motion_policy], seed=0)
    theirs = [cell for cell in cells if cell.spec == motion_policy]
    assert [cell.protocol for cell in theirs] == ["intervention"] * 3 + ["foot-displacement"]
    assert {cell.config.training for cell in theirs} == {"motion"}
    ours = [cell for cell in cells if cell.spec in SPECS and cell.protocol == "intervention"]
    assert {cell.config.training for cell in ours} == {"noise"}


def test_full_is_the_same_and_more():
    quick, full = (profile_cells(profile, SPECS) for profile in ("quick", "full"))
    work = [{}, {}]
    for found, cells in zip(work, (quick, full), strict=True):
        for cell in cells:
            found[cell.protocol] = found.get(cell.protocol, 0.0) + cell.work
    assert all(work[0][name] <= work[1][name] for name in work[0])
    assert sum(work[1].values()) > 20 * sum(work[0].values())


def test_an_unknown_profile_is_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'quick'"):
        profile_cells("quik", SPECS)
