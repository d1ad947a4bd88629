"""The learned policy: observation terms, networks, contracts and the files that hold them, and the controller itself.

Parts that need torch are imported on first use; paths, contracts and exported networks do not need it.
"""

from typing import TYPE_CHECKING, Any

from hugwbc.learned.policy.network_files import (
    DEFAULT_POLICY,
    POLICY_FILE,
    policy_file,
    shipped_contracts,
    shipped_policies,
)

if TYPE_CHECKING:
    from hugwbc.learned.policy.policy import LearnedController, load_policy, save_policy

__all__ = [
    "DEFAULT_POLICY",
    "POLICY_FILE",
    "LearnedController",
    "load_policy",
    "policy_file",
    "save_policy",
    "shipped_contracts",
    "shipped_policies",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  any of the names above
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from hugwbc.learned.policy import policy

    return getattr(policy, name)
