import pytest

from hugwbc.errors import UnknownNameError
from hugwbc.evaluation.controllers import ControllerSpec
from hugwbc.evaluation.report.profiles import profile_cells
from hugwbc.evaluation.report.sections import FIGURES

SPECS = [ControllerSpec("learned"), ControllerSpec("qp")]


@pytest.mark.parametrize("profile", ["quick", "full"])
def test_a_profile_has_every_protocol_of_the_report_for_every_controller(profile):
    cells = profile_cells(profile, SPECS, seed=3)
    assert {cell.protocol for cell in cells} == set(FIGURES)
    assert [cell.spec for cell in cells] == SPECS * (len(cells) // 2)
    assert {cell.config.seed for cell in cells} == {3}


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
