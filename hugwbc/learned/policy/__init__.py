"""The learned policy: observations, networks, the file with its contract and self-test, and the controller itself."""

from hugwbc.learned.policy.policy import (
    DEFAULT_POLICY,
    POLICY_FILE,
    LearnedController,
    load_policy,
    policy_dir,
    policy_file,
    save_policy,
    shipped_policies,
    trained_with,
)

__all__ = [
    "DEFAULT_POLICY",
    "POLICY_FILE",
    "LearnedController",
    "load_policy",
    "policy_dir",
    "policy_file",
    "save_policy",
    "shipped_policies",
    "trained_with",
]
