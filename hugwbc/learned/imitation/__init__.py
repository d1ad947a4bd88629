"""Learning from teachers: imitation of a controller such as the QP, and distillation of several policies into one."""

from hugwbc.learned.imitation.distillation import Distiller
from hugwbc.learned.imitation.imitation import Imitator

__all__ = ["Distiller", "Imitator"]
