"""Tasks of the whole-body QP, one file each."""

from hugwbc.mbc.tasks.angular_momentum import AngularMomentumTask
from hugwbc.mbc.tasks.centre_of_mass import CentreOfMassTask
from hugwbc.mbc.tasks.centre_of_mass_motion import CentreOfMassMotionTask
from hugwbc.mbc.tasks.pelvis_height import PelvisHeightTask
from hugwbc.mbc.tasks.pelvis_orientation import PelvisOrientationTask
from hugwbc.mbc.tasks.pelvis_travel import PelvisTravelTask
from hugwbc.mbc.tasks.posture import PostureTask
from hugwbc.mbc.tasks.stance_contact import StanceContactTask
from hugwbc.mbc.tasks.swing_foot import SwingFootTask
from hugwbc.mbc.tasks.task import Task, TaskTerms

__all__ = [
    "AngularMomentumTask",
    "CentreOfMassMotionTask",
    "CentreOfMassTask",
    "PelvisHeightTask",
    "PelvisOrientationTask",
    "PelvisTravelTask",
    "PostureTask",
    "StanceContactTask",
    "SwingFootTask",
    "Task",
    "TaskTerms",
]
