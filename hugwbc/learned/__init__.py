"""The learned controller: the HugWBC policy (Xue et al., RSS 2025), its training in MuJoCo, and shipped policies.

`policy` runs a network and needs nothing of the training; `config` holds every number of the training; `env` is the
environment, `rl` learns in it, and `recipe` makes a policy of them. The constants here are the paper's interface
between policy and robot, from which both a training and a policy file start.
"""

PERIOD = 0.02  # [s] of control
ACTION_SCALE = 0.25  # [rad] of joint target per unit of action
WAIST_RATE = 2.0  # [rad/s], at which the waist's joint target follows the commanded w (ours)
