import numpy as np


def actions(count: int, seed: int = 0) -> np.ndarray:
    """Return moderate random actions of a policy for the H1, shape (count, 19)."""
    return 0.3 * np.random.default_rng(seed).standard_normal((count, 19)).astype(np.float32)
