"""Learning from a teacher: imitation of the QP, and distillation of several policies into one."""
