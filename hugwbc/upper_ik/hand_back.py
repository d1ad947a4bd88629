"""The moment at which a controller's own arm command takes over again, made smooth."""

import dataclasses

import numpy as np

from hugwbc.blends import smooth_step
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.robot import load_robot

DECAY_TIME = 0.5  # [s]


class HandBack:
    """Lets the difference between the last external arm command and the controller's own fade.

    During a hand-back the takeover brings the arms to where the controller's own command was before. Meanwhile its arm
    swing may have gone on: what is left is added to its command at first, and fades over `DECAY_TIME`.
    """

    def __init__(self) -> None:
        self._arms = load_robot().arms
        self.reset()

    def reset(self) -> None:
        """Nothing fades."""
        self._last: np.ndarray | None = None
        self._offset = np.zeros(8)
        self._elapsed = DECAY_TIME

    def __call__(self, command: JointCommand, upper_body: UpperBody, dt: float) -> JointCommand:
        """The command whose arm positions do not jump when `upper_body` lets go of the arms; `dt` in [s]."""
        if upper_body.indicator:
            self._last, self._elapsed = command.q[self._arms].copy(), 0.0
            return command
        if self._last is not None:
            self._offset, self._last = self._last - command.q[self._arms], None
        if self._elapsed >= DECAY_TIME or not command.is_finite:
            return command
        q = command.q.copy()
        q[self._arms] += (1.0 - smooth_step(self._elapsed / DECAY_TIME)) * self._offset
        self._elapsed += dt
        return dataclasses.replace(command, q=q)
