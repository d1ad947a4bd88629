import math

import pytest

from hugwbc.errors import ConfigError
from hugwbc.mbc import ControllerParams


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"com_weight": math.nan}, "com_weight is nan; give finite numbers"),
        ({"height_gains": (120.0, math.inf)}, r"height_gains is \(120.0, inf\); give finite numbers"),
        ({"friction": 0.0}, "friction is 0.0; give a number above 0"),
        ({"mpc_intervals": -1}, "mpc_intervals is -1; give a number above 0"),
        ({"height_rate": (0.0, 2.0)}, r"height_rate is \(0.0, 2.0\); give numbers above 0"),
        ({"arm_gains": (100.0, 0.0)}, r"arm_gains is \(100.0, 0.0\); give numbers above 0"),
        ({"speed_fraction": 1.1}, "speed_fraction is 1.1; give a share above 0, up to 1"),
        ({"step_timing": 1.0}, "step_timing is 1.0; give a share from 0 to below 1"),
    ],
)
def test_what_would_fail_in_the_loop_is_refused_before_it(changes, message):
    with pytest.raises(ConfigError, match=message):
        ControllerParams(**changes)
