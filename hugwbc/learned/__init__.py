"""The learned controller: the HugWBC policy (Xue et al., RSS 2025), its training in MuJoCo, and shipped policies.

`policy` runs a network and needs nothing of the training; `config` holds the settings of the training; `env` is the
environment, `rl` learns in it, and `recipe` makes a policy with them, stage by stage.
"""

PERIOD = 0.02  # [s], the paper's control period
