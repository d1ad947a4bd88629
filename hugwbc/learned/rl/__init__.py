"""Reinforcement learning: PPO, the training loop with its checkpoints, evaluations inside it, and its log."""

from hugwbc.learned.rl.ppo import PPO
from hugwbc.learned.rl.trainer import Trainer, train

__all__ = ["PPO", "Trainer", "train"]
