"""Reinforcement learning: PPO, the training loop, its checkpoints and its log."""
