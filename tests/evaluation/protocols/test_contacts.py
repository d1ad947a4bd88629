import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.protocols.contacts import ContactsConfig, ContactsProtocol, clock_phases, fit_clock
from hugwbc.runtime.controllers import ControllerSpec


@pytest.mark.parametrize("gait", [Gait.WALKING, Gait.JUMPING, Gait.HOPPING_LEFT])
def test_a_shifted_clock_is_found_and_agrees(gait):
    contact = clock_phases(gait, 2.5, 0.3, 200) < 0.5
    offset, agreement = fit_clock(contact, gait, 2.5)
    assert agreement == 1.0
    assert abs((offset - 0.3 + 0.5) % 1.0 - 0.5) <= 0.02
    assert contact[:, 0].mean() == pytest.approx(0.5, abs=0.02)
    if gait is Gait.WALKING:
        assert np.mean(contact[:, 0] == contact[:, 1]) < 0.05
    if gait is Gait.HOPPING_LEFT:
        assert not contact[:, 1].any()


def test_a_foot_that_never_lifts_agrees_half_of_the_time():
    _, agreement = fit_clock(np.ones((200, 2), dtype=bool), Gait.WALKING, 2.0)
    assert agreement == pytest.approx(0.5, abs=0.02)
    assert fit_clock(np.ones((200, 2), dtype=bool), Gait.STANDING, 2.0)[1] == 1.0


def test_run_keeps_contacts_after_the_settling_time():
    result = ContactsProtocol().run(
        ControllerSpec("hold").build, ContactsConfig(Gait.STANDING, duration=0.4, settle=0.2)
    )
    (row,) = result.rows
    assert len(row.left) == len(row.right) == 10 and set(row.left) <= {0, 1}
    assert row.gait == "standing" and not row.fell
    with pytest.raises(ConfigError, match="episodes is 0; give 1 or more"):
        ContactsConfig(Gait.STANDING, episodes=0)


def test_the_report_has_the_mean_agreement():
    rows = [{"agreement": 0.25, "fell": False}, {"agreement": None, "fell": False}]
    (figure,) = ContactsProtocol().figures("qp", {"gait": "jumping", "rows": rows})
    assert (figure.quantity, figure.value, figure.higher_is_better) == ("jumping", 25.0, True)
