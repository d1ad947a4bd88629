import math

import pytest

from hugwbc.errors import ConfigError
from hugwbc.mbc import ControllerParams


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"com_weight": math.nan}, "com_weight"),
        ({"height_gains": (120.0, math.inf)}, r"height_gains\.1"),
        ({"friction": 0.0}, "friction is 0.0; .* greater than 0"),
        ({"mpc_intervals": -1}, "mpc_intervals"),
        ({"height_rate": (0.0, 2.0)}, r"height_rate\.0"),
        ({"arm_gains": (100.0, 0.0)}, r"arm_gains\.1"),
        ({"step_timing": 1.0}, "step_timing"),
    ],
)
def test_what_would_fail_in_the_loop_is_refused_before_it(changes, message):
    with pytest.raises(ConfigError, match=message):
        ControllerParams(**changes)
